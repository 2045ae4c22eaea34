"""What the command makes of Snakemake's words; the words themselves are those of the locked version."""

from pathlib import Path

import pytest
from calls import call_python

from wearscope.cli.progress import describe, format_seconds, show_progress
from wearscope.cli.workflow import Progress, explain_failure, read_setting

SNAKEFILE = """
rule all:
    input: "results/s/c.txt"

rule a:
    output: "results/s/a.txt"
    log: "results/s/logs/a.log"
    message: "Make the first"
    shell:
        "{a}touch {{output}}"

rule c:
    input: "results/s/a.txt"
    output: "results/s/c.txt"
    shell: "touch {{output}}"
"""


def run(folder, target="", body=""):
    """Call the command on a workflow of its own."""
    (folder / "Snakefile").write_text(SNAKEFILE.format(a=body))
    (folder / "config").mkdir(exist_ok=True)
    (folder / "config" / "config.yaml").write_text("study: s\n")
    stage = ["--stage", target] if target else []
    words = ("-m", "wearscope", "run", *stage, "--cores", 1, "--snakefile", "Snakefile")
    return call_python(*words, folder=folder, timeout=300)


@pytest.mark.slow
def test_a_run_is_quiet_and_leaves_its_log(tmp_path):
    done = run(tmp_path)
    assert done.returncode == 0 and done.stdout == ""
    told, last = done.stderr.splitlines()
    assert told == "Runs the workflow of Snakefile, not the platform's." and last.startswith(
        "3 jobs done in "
    )
    assert "Make the first" in (tmp_path / "results" / "wearscope-all.log").read_text()
    assert run(tmp_path).stderr.splitlines()[-1] == "Nothing to be done."


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "last"),
    [
        (
            "echo '[   0.1 s] robot x: too weak; correct it.' > {log}; exit 1; ",
            "robot x: too weak; correct it.",
        ),
        # In a pool, as the platform's jobs: the shell's own end counts.
        ("kill -9 $$; ", "a: its process was ended by SIGKILL, as by the system wh"),
    ],
    ids=["failed", "killed"],
)
def test_the_last_line_says_why_a_job_ended(tmp_path, body, last):
    done = run(tmp_path, body=body)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith(last)


@pytest.mark.slow
def test_a_target_that_is_not_there_is_named(tmp_path):
    last = run(tmp_path, "track").stderr.splitlines()[-1]
    assert last == "the workflow has no target track; update wearscope, or correct the name."


def read(*lines):
    progress = Progress()
    for line in lines:
        progress.read(line + "\n")
    return progress


def test_the_line_says_what_is_done_and_what_is_left():
    progress = read("total           40", "Job 3: Simulate medium", "10 of 40 steps (25%) done")
    assert (progress.done, progress.total, progress.message) == (10, 40, "Simulate medium")
    assert describe(progress, 30.0) == "10 of 40 jobs, 30 s, about 1 min 30 s left"
    assert describe(read("Building DAG of jobs..."), 2.0) == "planning, 2 s"


def test_the_line_says_how_far_a_long_job_is():
    progress = read("total           3", "Job 1: Simulate medium")
    job = "simulate_points medium slow identification 0: {}/40 points of identification\n"
    progress.read(job.format(4), 10.0)
    assert describe(progress, 11.0) == "0 of 3 jobs, 11 s; 4 of 40 points of identification"
    progress.read(job.format(14), 20.0)  # one a second
    said = "0 of 3 jobs, 20 s; 14 of 40 points of identification, about 26 s left"
    assert describe(progress, 20.0) == said
    progress.read("1 of 3 steps (33%) done\n", 50.0)
    assert describe(progress, 50.0) == "1 of 3 jobs, 50 s, about 1 min 40 s left"
    progress.read("close_loop: forward simulation, r1.csv, model after: ok\n", 60.0)
    assert progress.message == "forward simulation, r1.csv, model after: ok"


def test_a_terminal_gets_one_line_that_moves_and_is_gone_at_the_end(capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", "60")
    progress = read("total           40", "10 of 40 steps (25%) done", "Job 3: \x1b[2J" + 90 * "x")
    with show_progress(verbose=False) as watch:
        watch(progress, 30.0, "")
    told = capsys.readouterr().err
    assert "10 of 40 jobs" in told and "\n" not in told and "\x1b[2J" not in told
    first, last = told.split("\r")[1:]
    assert len(first.removesuffix("\x1b[K")) < 60 and last == "\x1b[K"


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (59.4, "59 s"), (200, "3 min 20 s"), (7500, "2 h 5 min")]
)
def test_times_are_short(seconds, text):
    assert format_seconds(seconds) == text


def test_a_defect_is_told_as_one_with_its_log(tmp_path):
    (tmp_path / "a.log").write_text("[   0.1 s] begun\nTraceback (most recent call last):\nTypeError: no\n")
    progress = read("Error in rule fit:", "    log: a.log (check log file(s) for error details)")
    told = explain_failure(progress, ("snr",), tmp_path)
    assert told == "fit: a defect of the program or of own code (TypeError: no); its log is a.log."


def test_what_the_snakefile_refuses_is_its_own_sentence():
    progress = read("Using workflow specific profile x", "config: robots: there is no 'y'; correct it.")
    assert explain_failure(progress, (), Path()) == "config: robots: there is no 'y'; correct it."


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("seed=2", {"seed": 2}),
        ("snr.runs=100", {"snr": {"runs": 100}}),
        ("surrogates.filling.points=20", {"surrogates": {"filling": {"points": 20}}}),
        ("dataset=a.b=c", {"dataset": "a.b=c"}),
        ("axes=[1, 2]", {"axes": [1, 2]}),
        ("dataset=null", {"dataset": None}),
        ("direct.enabled=false", {"direct": {"enabled": False}}),
        ("dataset=a: b #c", {"dataset": "a: b #c"}),
    ],
)
def test_a_setting_is_a_part_of_the_configuration(setting, told):
    assert read_setting(setting) == told


@pytest.mark.parametrize("setting", ["seed", "=2", "snr.=2", ".runs=2", "3=2"])
def test_what_is_no_setting_gets_one_sentence(setting, refuses):
    refuses(read_setting, setting)
