"""A study that is killed at any moment is finished by the same command to the same bytes.

A few kills run with `make test-slow`, twenty with `make test-kills`.
"""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import clones
import pandas as pd
import pytest
from calls import call, start, wait_until

from wearscope.home import example_dataset

COMMAND = [sys.executable, "-P", "-m", "wearscope"]
#: How a process is started whose output is read.
READ = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The finished study, and how long it took [s]."""
    folder = clones.copy_tree(tmp_path_factory.mktemp("undisturbed"))
    start = time.monotonic()
    clones.run_well(folder, cores=2)
    return folder, time.monotonic() - start


@pytest.fixture
def fresh(undisturbed, tmp_path):
    """The tree without results."""
    shutil.copytree(
        undisturbed[0], tmp_path / "study", ignore=shutil.ignore_patterns("results", ".snakemake")
    )
    return tmp_path / "study"


def start_and_kill(folder, seconds, group):
    """Start the study, kill it after some time; False where it was done before."""
    job = start(*clones.command(cores=2), folder=folder)
    try:
        job.wait(seconds)
        assert job.returncode == 0
        return False
    except subprocess.TimeoutExpired:
        (os.killpg if group else os.kill)(job.pid, signal.SIGKILL)
        job.wait()
        return True


def list_processes(folder):
    """Processes that work in a folder."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            state = (process / "stat").read_text().rpartition(")")[2].split()[0]
            if state != "Z" and (process / "cwd").readlink().is_relative_to(folder):
                found.append(int(process.name))
        except OSError:
            continue
    return found


def check_interrupted(folder, reference):
    """No process works on; what stands under a final name is whole."""
    assert wait_until(lambda: not list_processes(folder))
    for name, content in clones.digests(folder).items():
        assert content == (reference / "results" / "tiny" / name).read_bytes(), f"{name} is partial"


def check_finished(folder, reference):
    clones.run_well(folder, cores=2)
    assert clones.digests(folder) == clones.digests(reference)
    left = [path for path in (folder / "results").rglob(".*") if path.name.endswith((".part", ".damaged"))]
    assert left == []


@pytest.mark.slow
def test_killed_a_few_times_in_a_row(undisturbed, fresh):
    """The whole group, and the main process alone, at random moments of one study."""
    reference, seconds = undisturbed
    draw = random.Random(0)
    for group in (True, False, True):
        if not start_and_kill(fresh, draw.uniform(0.1, 0.5) * seconds, group):
            break
        check_interrupted(fresh, reference)
    check_finished(fresh, reference)


@pytest.mark.long
@pytest.mark.parametrize("number", range(20))
def test_killed_at_a_random_moment(undisturbed, fresh, number):
    reference, seconds = undisturbed
    moment = seconds * (number + random.Random(number).random()) / 20
    start_and_kill(fresh, moment, group=number % 4 != 3)
    check_interrupted(fresh, reference)
    check_finished(fresh, reference)


@pytest.mark.parametrize(
    "number", [pytest.param(k, marks=pytest.mark.slow if k < 3 else pytest.mark.long) for k in range(50)]
)
def test_an_interrupt_ends_all_within_seconds(tmp_path, number):
    """Ctrl-C goes to all processes of the terminal's foreground group."""
    job = start(*COMMAND, "diagnose", example_dataset(), folder=tmp_path, **READ)
    time.sleep(1.0 + 0.3 * number if number >= 3 else (2.0, 7.0, 11.0)[number])
    os.killpg(job.pid, signal.SIGINT)
    said, _ = job.communicate(timeout=5 + 10 * os.getloadavg()[0])
    assert job.returncode in (130, 0) and "Traceback" not in said
    assert (job.returncode == 130) == ("Interrupted" in said)
    assert list_processes(tmp_path) == []


@pytest.mark.slow
def test_a_job_that_somebody_kills_is_tried_once_more(undisturbed, fresh):
    """As the kernel does where memory is short; the study ends as one in which nothing was killed."""
    killed = []
    with open(fresh / "said.txt", "w") as file:
        study = subprocess.Popen(clones.command(cores=2), cwd=fresh, stdout=file, stderr=subprocess.STDOUT)
        while study.poll() is None and not killed:
            for process in list_processes(fresh):
                with suppress(OSError):
                    words = Path(f"/proc/{process}/cmdline").read_bytes()
                    if b".snakemake/scripts/" in words and b"bash" not in words and not killed:
                        os.kill(process, signal.SIGKILL)
                        killed.append(process)
            time.sleep(0.02)
        assert study.wait() == 0
    assert killed and "Trying to restart job" in (fresh / "said.txt").read_text()
    check_finished(fresh, undisturbed[0])


@pytest.mark.slow
def test_what_the_command_started_ends_with_it(tmp_path):
    job = start(*COMMAND, "diagnose", example_dataset(), folder=tmp_path)
    wait_until(lambda: len(list_processes(tmp_path)) >= 3, 60.0)
    job.kill()
    job.wait()
    assert wait_until(lambda: not list_processes(tmp_path))


def diagnose(folder):
    return call(*COMMAND, "diagnose", "arm", folder=folder)


DIAGNOSIS = ("verdict.json", "report.html", "residual.parquet", "model_after.yaml")
STUDY = (
    "conclusion.json", "report.html", "thresholds.parquet", "rankings.parquet", "findings.parquet",
    "figures/snr.svg", "figures/scope_w3.svg", "figures/scope_w3.png",
)  # fmt: skip


def read_answer(folder, place="closed_loop/example-arm", names=DIAGNOSIS):
    """Content of what an answer consists of, by file."""
    place = folder / "results" / place
    return {name: (place / name).read_bytes() for name in names if (place / name).is_file()}


@pytest.mark.slow
def test_a_study_that_is_killed_leaves_its_old_answer(undisturbed, tmp_path):
    """Where a new one was made, but its page was not; the same command shows all of the new one."""
    folder = shutil.copytree(undisturbed[0], tmp_path / "study", symlinks=True)
    old, config = read_answer(folder, "tiny", STUDY), folder / clones.TINY / "config.yaml"
    config.write_text(config.read_text().replace("scope: {", "scope: {p_f: 0.02, "))
    made = folder / "results" / "tiny" / "parts" / "answer" / "conclusion.json"
    before = made.read_bytes()
    with open(folder / "said.txt", "w") as said:
        job = start(*clones.command(), folder=folder, stdout=said, stderr=said)
        while job.poll() is None and not (made.is_file() and made.read_bytes() not in (before, b"")):
            time.sleep(0.02)
        os.killpg(job.pid, signal.SIGKILL)
        job.wait()
    assert job.returncode < 0 and made.read_bytes() != before
    assert read_answer(folder, "tiny", STUDY) == old and len(old) == len(STUDY)
    clones.run_well(folder)
    new = read_answer(folder, "tiny", STUDY)
    assert new == read_answer(folder, "tiny/parts/answer", STUDY)
    assert all(new[name] != old[name] for name in ("conclusion.json", "report.html", "figures/scope_w3.svg"))


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """A diagnosis, the same with other data, and how long it took [s]."""
    folders = [tmp_path_factory.mktemp("diagnosed") for _ in range(2)]
    for number, folder in enumerate(folders):
        shutil.copytree(example_dataset(), folder / "arm")
        if number:
            path = folder / "arm" / "runs" / "sweeps.parquet"
            pd.read_parquet(path)[:-200].to_parquet(path, index=False)
        start = time.monotonic()
        done = diagnose(folder)
        assert done.returncode == 0, done.stderr
    return *folders, time.monotonic() - start


@pytest.mark.parametrize(
    "number",
    [pytest.param(k, marks=pytest.mark.slow if k in (9, 18) else pytest.mark.long) for k in range(20)],
)
def test_a_diagnosis_that_is_killed_leaves_the_old_answer_or_the_new_one(diagnosed, tmp_path, number):
    """And is finished by the same command to the same bytes, on data that changed."""
    old, new, seconds = diagnosed
    folder = tmp_path / "here"
    shutil.copytree(old, folder)
    shutil.copy(new / "arm" / "runs" / "sweeps.parquet", folder / "arm" / "runs")
    job = start(*COMMAND, "diagnose", "arm", folder=folder)
    try:
        job.wait(seconds * (number + random.Random(number).random()) / 20)
    except subprocess.TimeoutExpired:
        os.kill(job.pid, signal.SIGKILL)
        job.wait()
    assert wait_until(lambda: not list_processes(folder))
    shown = call(*COMMAND, "report", "results/closed_loop/example-arm", folder=folder)
    assert shown.returncode == 0 and "report.html" in shown.stdout, shown.stderr
    assert read_answer(folder) in (read_answer(old), read_answer(new)) and len(read_answer(old)) == 4
    assert diagnose(folder).returncode == 0
    assert read_answer(folder) == read_answer(new)


@pytest.mark.slow
@pytest.mark.parametrize("apart", [0.0, 6.0])
@pytest.mark.parametrize("first", ["snakemake", "wearscope"])
def test_two_programs_on_one_study_at_once(undisturbed, fresh, first, apart):
    """One waits for the other; whichever is later finds its files there, or makes them again, the same."""
    reference, _ = undisturbed
    study = f"{clones.TINY}/config.yaml"
    ways = {"snakemake": clones.command(), "wearscope": [*COMMAND, "run", study, "--cores", "1"]}
    runs = []
    for name in sorted(ways, key=lambda name: name != first):
        runs.append(start(*ways[name], folder=fresh, **READ))
        time.sleep(apart)
    said = [run.communicate()[0] for run in runs]
    assert [run.returncode for run in runs] == [0, 0], said
    assert "this one waits for its end" in said[0] + said[1]
    assert not [one for one in said if "set aside" in one]
    check_finished(fresh, reference)


@pytest.mark.long
@pytest.mark.parametrize("size", ["1m", "3m"])
def test_full_disk_ends_in_one_sentence_and_the_study_goes_on(undisturbed, fresh, size):
    place = fresh / "results"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("a small file system cannot be mounted here (that needs root and CAP_SYS_ADMIN)")
    try:
        done = clones.run(fresh)
        assert done.returncode == 1
        assert "No space left on device" in done.stderr and "free disk space" in done.stderr
        whole = clones.digests(fresh)
        assert all(
            whole[name] == one for name, one in clones.digests(undisturbed[0]).items() if name in whole
        )
        subprocess.run(["mount", "-o", "remount,size=200m", str(place)], check=True)
        check_finished(fresh, undisturbed[0])
    finally:
        subprocess.run(["umount", str(place)], check=True)
