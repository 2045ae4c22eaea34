"""What a workflow script says and how it ends."""

import errno
import hashlib
import importlib.util
import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from calls import call, call_python, wait_until

from wearscope import processes
from wearscope.errors import InputError
from wearscope.storage import files, tables

_SPEC = importlib.util.spec_from_file_location(
    "workflow_job", Path(__file__).parents[2] / "workflow" / "scripts" / "job.py"
)
job = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(job)


@pytest.fixture
def snakemake(tmp_path):
    return SimpleNamespace(rule="compute_it", wildcards=["medium"], log=[str(tmp_path / "it.log")])


def test_progress_and_end_are_logged_and_said(snakemake, capsys):
    Path(snakemake.log[0]).write_text("of an earlier run")
    with job.run_job(snakemake) as say:
        report = job.count_progress(say, 3, "points")
        for done in (1, 2, 3):
            report(done)
    lines = Path(snakemake.log[0]).read_text().splitlines()
    assert [line.split("] ")[1] for line in lines] == ["3/3 points", "done"]
    assert capsys.readouterr().err == "compute_it medium: 3/3 points\n"


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (InputError("row 3: no such thing; correct it."), "row 3: no such thing; correct it."),
        (
            OSError(errno.ENOSPC, "No space left on device", "models/x.urdf"),
            "models/x.urdf: the disk at ",
        ),
        (
            OSError(errno.ENOSPC, "No space left"),
            " is full (No space left); free disk space there.",
        ),
    ],
)
def test_bad_input_and_full_disk_end_in_one_sentence(snakemake, capsys, error, sentence, full):
    """Where the disk is full, the log cannot say it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0 if full else soft, hard))
    try:
        with pytest.raises(SystemExit) as end, job.run_job(snakemake):
            raise error
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert end.value.code == 1
    said = capsys.readouterr().err
    assert said.startswith("compute_it medium: ") and sentence in said and said.count("\n") == 1
    assert (sentence in Path(snakemake.log[0]).read_text()) == (not full)


@pytest.mark.parametrize("error", [TypeError("a defect"), OSError(errno.EACCES, "Permission denied")])
def test_a_defect_is_raised_with_its_traceback_in_the_log(snakemake, error):
    with pytest.raises(type(error)), job.run_job(snakemake):
        raise error
    assert "Traceback" in Path(snakemake.log[0]).read_text()


@pytest.fixture
def study(tmp_path, monkeypatch, snakemake):
    """A job between two files of a study."""
    monkeypatch.chdir(tmp_path)
    snakemake.input = ["results/tiny/given.json", "src/code.py"]
    snakemake.output = ["results/tiny/made.json"]
    tables.write_text("results/tiny/given.json", '{"y": 17.61}')
    files.record_checksums("results/tiny", ["results/tiny/given.json"])
    return snakemake


def test_what_a_job_writes_is_checked_by_the_next(study, capsys):
    with job.run_job(study):
        tables.write_text("results/tiny/made.json", "1")
    text = Path("results/tiny/.checksums/made.json.sha256").read_text()
    assert text == f"{hashlib.sha256(b'1').hexdigest()}  made.json\n"
    given = Path("results/tiny/given.json")
    stat = given.stat()
    given.write_text('{"y": 17.62}')
    os.utime(given, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    with pytest.raises(SystemExit), job.run_job(study):
        pytest.fail("the job was run on a damaged file")
    said = capsys.readouterr().err
    assert "results/tiny/given.json: is not what was written (its checksum differs)" in said
    assert "run the same command again" in said and said.count("\n") == 1
    assert not given.exists() and Path("results/tiny/.given.json.damaged").read_text() == '{"y": 17.62}'
    tables.write_text(given, '{"y": 17.61}')
    assert not Path("results/tiny/.given.json.damaged").exists()
    with job.run_job(study):
        tables.write_text("results/tiny/made.json", "1")


def test_damage_within_a_job_withdraws_the_recording_and_its_chunk(study, capsys):
    folder = Path("results/tiny/traces/medium/moves/identification")
    for number, points in enumerate(({"1": "a"}, {"2": "b"})):
        tables.write_text(
            folder / f"_chunk-{number}.json", json.dumps({"fingerprints": points, "failed": {}})
        )
    tables.write_text(folder / "point=2" / "recording.parquet", "no table")
    with pytest.raises(SystemExit), job.run_job(study):
        tables.read_table(folder / "point=2" / "recording.parquet")
    assert "point=2/recording.parquet: not a whole Parquet file" in capsys.readouterr().err
    assert not (folder / "point=2" / "recording.parquet").exists()
    assert [path.name for path in folder.glob("_chunk*")] == ["_chunk-0.json"]


def test_damage_outside_the_results_is_told_and_left(study, tmp_path, capsys):
    (tmp_path / "mine.parquet").write_text("no table")
    with pytest.raises(SystemExit), job.run_job(study):
        tables.read_table("mine.parquet")
    assert "delete it and make it again" in capsys.readouterr().err
    assert (tmp_path / "mine.parquet").exists()


def test_a_job_ends_with_the_process_it_works_for():
    script = (
        "import os, subprocess, sys, time\n"
        "from wearscope.processes import MAIN, identify_process\n"
        "worker = 'import os, sys, time; from wearscope.processes import end_with;'\n"
        "worker += 'end_with(sys.argv[1]); print(os.getpid(), flush=True); time.sleep(60)'\n"
        "subprocess.Popen([sys.executable, '-c', worker, identify_process(os.getpid())])\n"
        "time.sleep(60)\n"
    )
    main = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    worker = int(main.stdout.readline())
    assert processes.identify_process(worker)
    main.kill()
    main.wait()
    main.stdout.close()
    assert wait_until(lambda: not _runs(worker), 5.0, 0.01)


def _runs(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_job_whose_main_process_is_gone_does_not_start():
    gone = subprocess.Popen([sys.executable, "-c", ""])
    identity = processes.identify_process(gone.pid)
    gone.wait()
    code = "import sys; from wearscope.processes import end_with; end_with(sys.argv[1]); print('here')"
    for other in (identity, identity.split(":")[0] + ":1", f"{os.getpid()}:1"):
        done = call_python("-c", code, other)
        assert done.returncode == -signal.SIGKILL and not done.stdout
    for other in ("", processes.identify_process(os.getpid())):
        done = call_python("-c", code, other)
        assert done.returncode == 0 and done.stdout == "here\n"


@pytest.mark.parametrize("full", [False, True])
def test_an_output_that_cannot_be_written_is_no_success(tmp_path, full):
    code = (
        "import resource; from wearscope.processes import end_process\n"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({0 if full else 1000}, resource.RLIM_INFINITY))\n"
        "print('the answer'); end_process(0)"
    )
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with (tmp_path / "said").open("w") as out:
        done = subprocess.run(
            [sys.executable, "-c", code], stdout=out, stderr=subprocess.PIPE, env=buffered, check=False
        )
    assert done.returncode == full
    assert done.stderr == (b"The output is lost: File too large; write it elsewhere.\n" if full else b"")


def test_a_job_that_ended_well_says_what_it_took(snakemake, tmp_path):
    snakemake.log = [str(tmp_path / "study" / "logs" / "simulate" / "x.log")]
    Path(snakemake.log[0]).parent.mkdir(parents=True)
    before = time.process_time()
    with job.run_job(snakemake):
        while time.process_time() < before + 0.2:
            pass
        kept = bytearray(50 * 2**20)
    row = read_row(tmp_path / "study" / "benchmarks" / "simulate" / "x.tsv")
    assert 0.2 <= row["s"] < 60
    used = sum(os.times()[:4])
    assert before + 0.19 <= row["cpu_time"] <= used + 0.1  # of four clocks of 10 ms
    assert row["max_rss"] > len(kept) / 2**20


def test_a_job_that_fails_says_no_costs(snakemake, tmp_path):
    with pytest.raises(SystemExit), job.run_job(snakemake):
        raise InputError("row 3: no such thing; correct it.")
    assert list(tmp_path.glob("*.tsv")) == []


def read_row(path):
    header, row = path.read_text().splitlines()
    return dict(zip(header.split("\t"), map(float, row.split("\t")), strict=True))


@pytest.mark.parametrize(
    ("ends", "code", "said"), [("pass", 0, ["job"]), ("sys.exit(3)", 3, ["job", "libraries"])]
)
def test_only_a_job_that_ended_well_leaves_without_taking_libraries_down(tmp_path, ends, code, said):
    """What is done at the end is done, but for what was there before the job; another end stays as it is."""
    script = f"""
import atexit, sys
from types import SimpleNamespace
atexit.register(lambda: print("libraries"))
sys.path.insert(0, {str(Path(job.__file__).parent)!r})
from job import run_job
atexit.register(lambda: print("job"))
class Snakemake(SimpleNamespace):
    pass
with run_job(Snakemake(rule="it", wildcards=[], log=[{str(tmp_path / "it.log")!r}], output=[])):
    {ends}
"""
    done = call_python("-c", script)
    assert (done.returncode, done.stdout.split(), done.stderr) == (code, said, "")


def call_plain(code, folder, *arguments):
    return call(*processes.PYTHON, "-c", code, *arguments, folder=folder, timeout=60)


@pytest.mark.parametrize("code", [0, 1])
def test_a_command_ends_as_it_says_where_libraries_abort_at_the_end(tmp_path, code):
    """As threads of C++ do that are still there when their objects are taken down."""
    done = call_plain(
        "import atexit, ctypes, sys\n"
        "from wearscope.processes import end_process\n"
        "ctypes.pythonapi.Py_AtExit(ctypes.CFUNCTYPE(None)(('abort', ctypes.CDLL(None))))\n"
        "atexit.register(print, 'cleared')\n"
        "end_process(int(sys.argv[1]))",
        tmp_path, str(code),
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (code, "cleared\n")


def test_settings_of_libraries_in_the_working_directory_are_not_obeyed(tmp_path):
    """Nor read: a pipe would hold the reader for good."""
    (tmp_path / ".numba_config.yaml").write_text("disable_jit: 1\n")
    os.mkfifo(tmp_path / "matplotlibrc")
    done = call_plain(
        "from wearscope.processes import ignore_settings_here as ignore; ignore()\n"
        "import matplotlib, numba\n"
        "from numba.core import config\n"
        "config.reload_config(); print(config.DISABLE_JIT)",
        tmp_path,
    )
    assert done.stdout == "0\n", done.stderr


def test_a_job_that_refuses_its_input_does_not_work_again_in_the_same_run(snakemake, capsys, monkeypatch):
    worked, log = [], Path(snakemake.log[0])
    monkeypatch.setattr(job, "end_with", lambda identity: None)

    def attempt(main, error, ends):
        monkeypatch.setenv(processes.MAIN, main)
        log.unlink(missing_ok=True)  # as Snakemake does
        with pytest.raises(ends), job.run_job(snakemake):
            worked.append(main)
            raise error
        return capsys.readouterr().err, log.read_text()

    empty, defect = InputError("r.csv: is empty; record again."), ValueError("a defect")
    first = attempt("7:1", empty, SystemExit)
    again = attempt("7:1", empty, SystemExit)
    assert worked == ["7:1"] and "r.csv: is empty" in again[0] and again[1] == first[1]
    attempt("8:1", defect, ValueError)
    assert "ValueError: a defect" in attempt("8:1", defect, SystemExit)[1]
    assert worked == ["7:1", "8:1"]
    attempt("8:1", empty, SystemExit)  # a third time it works again: what it said was of the last try
    assert worked == ["7:1", "8:1", "8:1"]
