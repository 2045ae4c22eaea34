"""The command itself: help, what it refuses, what it shows."""

import json
import sys
import time

import pandas as pd
import pytest
from calls import call_python
from click.testing import CliRunner

from wearscope.cli.main import COMMANDS, main, wearscope
from wearscope.cli.new import KINDS
from wearscope.storage import tables
from wearscope.storage.files import SETTINGS


def call(*arguments):
    return CliRunner().invoke(wearscope, [str(one) for one in arguments], catch_exceptions=True)


@pytest.mark.parametrize(
    "command", [(), *((one,) for one in COMMANDS), *(("new", one) for one in KINDS)], ids=" ".join
)
def test_every_command_has_help_with_an_example(command):
    outcome = call(*command, "--help")
    assert outcome.exit_code == 0
    assert "Example" in outcome.output or command == ("new",)
    assert "wearscope " in outcome.output


def test_help_comes_at_once():
    start = time.perf_counter()
    code = "import sys; from wearscope.cli.main import wearscope; assert 'numba' not in sys.modules; " \
        "assert 'pandas' not in sys.modules; wearscope(['--help'])"  # fmt: skip
    assert call_python("-c", code).returncode == 0
    assert time.perf_counter() - start < 5.0


def test_words_are_completed(monkeypatch):
    monkeypatch.setenv("_WEARSCOPE_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", "wearscope new d")
    monkeypatch.setenv("COMP_CWORD", "2")
    outcome = CliRunner().invoke(wearscope, [], prog_name="wearscope")
    assert {"plain,dataset", "plain,detector"} <= set(outcome.output.split())


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["run"], "no config/config.yaml is here; make one with 'wearscope new study NAME'"),
        (["run", "nothing"], "nothing: is no study's folder or configuration"),
        (["diagnose", "nothing"], "nothing: no such file"),
        (["check", "nothing"], "nothing: is no study's folder"),
        (["show", "snr"], "no config/config.yaml is here"),
        (["show", "x.txt"], "is no table; name"),
        (["new", "robot", "none.urdf"], "none.urdf: no such file"),
        (["new", "detector", "My-Detector"], "use small letters"),
        (["new", "study", "s" * 101], "take at most 100 characters"),
        (["new", "effect", "coulomb"], "is the platform's own"),
        (["new", "cycle", "c", "--via", "a b"], "holds other than numbers"),
        (["new", "cycle", "c", "--via", "30 10"], "say --unit rad or deg"),
        (["new", "study", "s", "--detector", "="], "--detector =: names none"),
        (["new", "study", "s", "--robot", "none"], "robot 'none': no such model file"),
        (["new", "dataset", "none.csv", "--urdf", "none.urdf"], "none.urdf: no such file"),
    ],
)
def test_what_cannot_be_done_ends_in_one_sentence(arguments, told, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.txt").write_text("")
    monkeypatch.setattr(sys, "argv", ["wearscope", *arguments])
    monkeypatch.setattr("wearscope.cli.main.end_process", sys.exit)
    with pytest.raises(SystemExit) as ended:
        main()
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert ended.value.code == 1 and told in last
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.txt"], "nothing is half-written"


def test_nothing_is_written_over(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert call("new", "detector", "own").exit_code == 0
    (tmp_path / "own.py").write_text("mine")
    done = call_python("-m", "wearscope", "new", "detector", "own", folder=tmp_path)
    assert done.returncode == 1 and "own.py: is there already" in done.stderr
    assert (tmp_path / "own.py").read_text() == "mine"


@pytest.fixture
def results(tmp_path):
    """A folder of results with one table."""
    frame = pd.DataFrame({"fda": ["A", "B", "C"], "snr": [1.5, float("nan"), 12.25], "axis": [1, 2, 3]})
    frame["theta"] = [[0.1, 0.2]] * 3
    tables.write_table(tmp_path / "snr.parquet", frame, {"snr": "N m", "axis": "-"})
    settings = {"detectors": {"C": {"use": "friction_fit"}}}
    (tmp_path / SETTINGS).write_text(json.dumps(settings))
    return tmp_path


def test_a_table_is_shown_with_units_and_n_a(results):
    text = call("show", "snr", "--in", results).output
    assert "snr [N m]  axis\n" in text and "12.25" in text and "n/a" in text
    assert text.startswith("detector ") and "Friction fit (C)" in text and "theta" not in text


def test_rows_are_chosen_sorted_and_cut(results):
    lines = call(
        "show", "snr", "--in", results, "--sort", "-snr", "--columns", "fda,snr", "--rows", 1
    ).output.splitlines()
    assert lines[1].split() == ["Friction", "fit", "(C)", "12.25"] and "axis" not in lines[0]
    assert "12.25" in call("show", "snr", "--in", results, "--where", "detector=C").output
    assert call("show", "snr", "--in", results, "--where", "axis=2").output.splitlines()[1].split()[0] == "B"


def test_a_missing_table_or_column_names_those_that_are_there(results):
    assert "there are snr" in str(call("show", "scope", "--in", results).exception)
    assert "it has fda, snr, axis, theta" in str(
        call("show", "snr", "--in", results, "--sort", "x").exception
    )


def test_what_there_is_is_listed(results):
    assert "Q-2" in call("show", "--in", results).output


def test_two_loops_are_compared_joint_by_joint(tmp_path):
    for name, error, named in (("may", 2.0, []), ("june", 3.0, [{"joint": "a1", "effect": "stribeck"}])):
        content = {"joints": {"a1": {"rms_before": error, "rms_after": 1.0}}, "verdict": named}
        (tmp_path / name).mkdir()
        (tmp_path / name / "verdict.json").write_text(json.dumps(content))
    text = call("compare", tmp_path / "may", tmp_path / "june").output
    assert text.splitlines()[-1].split() == ["a1", "2", "1", "3", "1", "Stribeck", "friction"]
