"""How plain Snakemake ends: with a page's answer, or with the rule that failed and what it said last."""

import shutil
from pathlib import Path

import pytest
from calls import call_python

from wearscope.home import find_home
from wearscope.reporting.page import Section, render_page
from wearscope.reporting.page_strip import Strip

#: A workflow of one rule that knows what the platform's rule of endings needs.
SNAKEFILE = """
import json, time
from pathlib import Path
from types import SimpleNamespace
R, LOOP_PAGE, RE, DATASET = "results/tiny", "results/loop", "results/tiny/reevaluation", None
STUDY, STARTED = SimpleNamespace(partitions=SimpleNamespace(number=None)), time.monotonic()
config = {{"study": "tiny"}}
include: "{ending}"
rule all:
    default_target: True
    input: "results/tiny/report.html"
rule write_page:
    input: "page.html"
    output: "results/tiny/report.html"
    log: "results/tiny/logs/write_page.log"
    shell: "cp {{input}} {{output}} && {command}"
"""
ANSWER = Strip("Use it.", "good", "In 20 of 20.", "One robot only.", "Record more.")


@pytest.fixture
def end(tmp_path):
    """What Snakemake says where its one rule ends with a shell command, and its exit code."""
    (tmp_path / "page.html").write_text(render_page("Tiny", [Section("One", "text", "one")], strip=ANSWER))
    home = tmp_path / "home" / "workflow" / "rules"
    home.mkdir(parents=True)
    shutil.copy(find_home() / "workflow" / "rules" / "ending.smk", home)

    def run(command: str) -> tuple[int, list[str]]:
        text = SNAKEFILE.format(ending=home / "ending.smk", command=command)
        (tmp_path / "Snakefile").write_text(text)
        words = ("-m", "snakemake", "--cores", 1, "--workflow-profile", "none")
        done = call_python(*words, folder=tmp_path, timeout=120)
        return done.returncode, done.stderr.splitlines()

    return run


def test_a_run_that_ended_well_prints_the_answer_in_five_lines_and_its_time(end, tmp_path):
    code, told = end("true")
    first = told.index("Use it.")
    assert code == 0
    assert told[first + 1 : first + 5] == [
        "How sure: In 20 of 20.",
        "Mind: One robot only.",
        "Next: Record more.",
        "results/tiny/report.html",
    ]
    assert told[first + 5].startswith("Done in ") and told[first + 5].endswith("GB of the disk are free.")
    assert "Use it." in (tmp_path / "results" / "history.jsonl").read_text()


def test_a_run_that_failed_names_the_rule_and_the_last_line_of_its_log(end):
    code, told = end("echo '[   0.1 s] The disk is full.' > {log} && false")
    assert code == 1
    (line,) = [one for one in told if one.startswith("The rule ")]
    log = Path("results/tiny/logs/write_page.log")
    assert line == f"The rule write_page failed: The disk is full. Its log is {log}."
