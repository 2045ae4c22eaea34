"""The data set that is named is the one that is asked, and nothing that lies in a folder runs."""

import json
import os
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import click
import pytest
import yaml
from calls import call
from changed_fields import changed_fields
from click.testing import CliRunner
from snakemake.common.configfile import load_configfile

from wearscope import example_dataset
from wearscope.cli import stages
from wearscope.cli.main import wearscope
from wearscope.cli.study import StudyPlace, check_code_named, list_code
from wearscope.cli.workflow import build_command, keep_settings, merge, read_setting
from wearscope.closed_loop.intake.data_folder import digest_dataset
from wearscope.closed_loop.intake.dataset_fields import load_fields
from wearscope.errors import InputError
from wearscope.home import find_home
from wearscope.processes import PYTHON, isolate

NAMES = [
    "arm #2",
    "a: b",
    "a{b}",
    "it's",
    'a"b',
    "-rf",
    "null",
    "1e3",
    "[x]",
    "Ärm 機",
    "😀",
    "a\nb",
    "'q'",
    "true",
]


@pytest.mark.parametrize("name", NAMES)
def test_snakemake_gets_the_very_text(name, tmp_path):
    with keep_settings(tmp_path, {"dataset": name, "export": {"model": name}}) as file:
        assert load_configfile(file) == {"dataset": name, "export": {"model": name}}
    assert not file.exists()
    if name not in ("null", "1e3", "[x]", "true", "'q'"):  # which --set takes for what they are
        assert read_setting(f"dataset={name}") == {"dataset": name}


@pytest.fixture
def handed(monkeypatch):
    """The settings that Snakemake would read, which is not called."""
    read = {}

    def call(command, folder, log, watch):
        assert command[1] == "-P" and command[-2] == "--"
        read.update(load_configfile(command[command.index("--configfile") + 1]))
        raise InputError("so far.")

    monkeypatch.setattr(stages, "call_snakemake", call)
    return read


def write_study(folder, settings):
    (folder / "config").mkdir()
    text = settings if isinstance(settings, str) else yaml.safe_dump(settings)
    (folder / "config" / "config.yaml").write_text(text)


COMMANDS = {
    "diagnose": ("diagnose", ["{}"], "dataset"),
    "track": ("track", ["{}"], "dataset"),
    "detect": ("detect", ["{}"], "dataset"),
    "reevaluate": ("reevaluate", ["quick", "--dataset", "{}"], "dataset"),
    "export": ("export", ["{}/robot.urdf"], "export"),
}


@pytest.mark.parametrize("name", [one for one in NAMES if one != "-rf"] + ["./-rf"])
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_hands_on_the_path_that_was_named(command, name, tmp_path, monkeypatch, handed):
    """Of two folders whose names begin alike, the one that was named; what Snakemake would read is read."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(example_dataset(), tmp_path / name)
    shutil.copytree(example_dataset(), tmp_path / "arm")
    monkeypatch.setattr("wearscope.detection.run.check_recordings", lambda dataset: None)
    _, arguments, key = COMMANDS[command]
    CliRunner().invoke(wearscope, [command, *(one.format(name) for one in arguments)])
    asked = handed[key] if key == "dataset" else str(Path(handed[key]["model"]).parent)
    assert asked == str((tmp_path / name).resolve())


@pytest.mark.parametrize("carried", [True, False])
def test_a_factor_of_a_payload_that_nobody_declared_is_dropped_before_anything_is_computed(
    carried, tmp_path, monkeypatch, handed
):
    shutil.copytree(example_dataset(), tmp_path / "arm")
    with changed_fields(tmp_path / "arm" / "dataset.yaml") as fields:
        for run in fields["runs"]:
            run["payload"] = {"mass": 1.0, "com": [0.0, 0.0, 0.0]} if carried else None
    monkeypatch.chdir(tmp_path)
    said = CliRunner().invoke(wearscope, ["reevaluate", "quick", "--dataset", "arm"]).output
    assert ("states no payload" in said) is not carried
    assert (handed.get("screening") == "drop") is not carried


def test_an_answer_about_other_files_is_not_shown(tmp_path, refuses):
    shutil.copytree(example_dataset(), tmp_path / "arm")
    digest = digest_dataset(tmp_path / "arm", load_fields(tmp_path / "arm" / "dataset.yaml"))
    answer = tmp_path / "verdict.json"
    answer.write_text(json.dumps({"dataset_digest": digest}))
    stages._check_asked(answer, tmp_path / "arm")
    run = next((tmp_path / "arm" / "runs").iterdir())
    run.write_bytes(run.read_bytes() + b"x")
    with pytest.raises(InputError, match=r"is about other files than those of .*arm"):
        stages._check_asked(answer, tmp_path / "arm")


def test_nothing_that_lies_in_a_data_set_runs(tmp_path):
    """Modules that Python would import, a workflow, a profile, settings of git: none is run or obeyed."""
    shutil.copytree(example_dataset(), tmp_path, dirs_exist_ok=True)
    code = f"open({str(tmp_path / 'ran')!r}, 'w')\n"
    for name in ("yaml", "snakemake", "json", "numpy", "sitecustomize", "job"):
        (tmp_path / f"{name}.py").write_text(code)
    (tmp_path / "Snakefile").write_text(code)
    (tmp_path / "profiles" / "default").mkdir(parents=True)
    (tmp_path / "profiles" / "default" / "config.yaml").write_text("snakefile: Snakefile\n")
    hook = f"touch '{tmp_path / 'ran'}'"
    for words in (("init", "-q"), ("config", "core.fsmonitor", hook)):
        assert call("git", *words, folder=tmp_path).returncode == 0
    scripts = Path(sys.executable).with_name("wearscope")
    command = [str(scripts)] if scripts.is_file() else [*PYTHON, "-m", "wearscope"]
    environment = {**os.environ, "PYTHONPATH": ""}
    done = call(*command, "diagnose", ".", "--dry-run", folder=tmp_path, env=environment)
    assert done.returncode == 0 and "jobs to do" in done.stdout, done.stderr
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    "command",
    ["wearscope run . -n", "wearscope run config/config.yaml -n", "wearscope check .", "snakemake -n"],
)
def test_a_configuration_that_is_a_template_is_refused_before_it_runs(command, tmp_path):
    """Snakemake runs Python within a file after ``--configfile`` before it reads any workflow."""
    text = (find_home() / "config" / "quick.yaml").read_text()
    code = f"? open({str(tmp_path / 'ran')!r}, 'w').close() or 'x'"
    write_study(tmp_path, f"__use_yte__: true\n{text}\n{json.dumps(code)}: 1\n")
    name, *words = command.split()
    words += ["--snakefile", str(find_home() / "Snakefile"), "--cores", "1"] if name == "snakemake" else []
    done = call(*PYTHON, "-m", name, *words, folder=tmp_path, env=isolate(os.environ))
    assert done.returncode == 1 and "__use_yte__ lets code in the file run" in done.stdout + done.stderr
    assert not (tmp_path / "ran").exists()


def test_no_modules_for_snakemake_come_with_a_folder(tmp_path, refuses):
    """It would import plugins from there by their names alone."""
    module = tmp_path / ".snakemake" / "pip-deployments" / "snakemake_logger_plugin_x"
    module.mkdir(parents=True)
    refuses(build_command, (), tmp_path, 1, tmp_path / "settings.json")


def test_a_child_has_no_folder_of_the_data_on_its_path(tmp_path):
    (tmp_path / "yaml.py").write_text("raise SystemExit(7)")
    environment = isolate({**os.environ, "PYTHONPATH": f":{os.pathsep}.{os.pathsep}/x"})
    assert environment["PYTHONPATH"] == "/x"
    for command in (PYTHON, [sys.executable]):
        assert call(*command, "-c", "import yaml", folder=tmp_path, env=environment).returncode == 0


def test_code_of_a_study_that_nobody_named_is_refused(tmp_path, monkeypatch):
    shutil.copytree(example_dataset(), tmp_path / "arm")
    write_study(tmp_path, {"study": "s", "robots": ["medium"], "detectors": {"X": {"use": "evil.py"}}})
    monkeypatch.chdir(tmp_path)
    seen = []
    monkeypatch.setattr(stages, "call_snakemake", lambda *given: seen.append(given) or (1, stages.Progress()))
    outcome = CliRunner().invoke(wearscope, ["diagnose", "arm"])
    assert isinstance(outcome.exception, InputError) and not seen
    assert "names code that would run (evil.py)" in str(outcome.exception)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    outcome = CliRunner().invoke(wearscope, ["diagnose", "arm", "--study", "."])
    assert "--allow-code" in str(outcome.exception) and not seen
    CliRunner().invoke(wearscope, ["check", ".", "--allow-code"])
    monkeypatch.setattr(stages, "call_snakemake", lambda *given: (_ for _ in ()).throw(InputError("so far.")))
    outcome = CliRunner().invoke(wearscope, ["diagnose", "arm", "--study", "."])
    assert "config.yaml names runs: evil.py." in outcome.output and "so far" in str(outcome.exception)


def test_a_check_says_which_code_of_a_study_runs_and_runs_none_that_nobody_named(tmp_path, monkeypatch):
    settings = yaml.safe_load((find_home() / "config" / "quick.yaml").read_text())
    write_study(tmp_path, settings | {"cycles": ["own.py"]})
    (tmp_path / "own.py").write_text(f"print('ran')\nopen({str(tmp_path / 'ran')!r}, 'w').close()\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    outcome = CliRunner().invoke(wearscope, ["check"])
    assert "names code that would run (own.py)" in str(outcome.exception)
    assert not (tmp_path / "ran").exists()
    told = str(CliRunner().invoke(wearscope, ["check", "."]).exception)
    assert f"let it run once and for all: wearscope check {tmp_path} --allow-code." in told
    assert not (tmp_path / "ran").exists()
    outcome = CliRunner().invoke(wearscope, ["check", ".", "--allow-code"])
    assert outcome.output.index("config.yaml names runs: own.py.") < outcome.output.index("ran\n")
    # Remembered for this content: what is refused now is the file's own fault.
    assert "own.py: defines no CYCLE" in CliRunner().invoke(wearscope, ["check", "."]).output


def test_somebody_at_a_terminal_is_asked_once_for_each_content(tmp_path, monkeypatch, refuses):
    (tmp_path / "own.py").write_text("x = 1\n")
    place = StudyPlace(tmp_path, tmp_path / "config.yaml")
    asked, answers = [], [False, True, True]
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True))
    monkeypatch.setattr(click, "confirm", lambda told, err: asked.append(told) or answers[len(asked) - 1])
    settings = {"cycles": ["own.py"]}
    refuses(check_code_named, place, settings)
    for expected in (2, 2, 3, 3):
        if expected == 3:
            (tmp_path / "own.py").write_text("x = 2\n")
        check_code_named(place, settings)
        assert len(asked) == expected
    assert "own.py. Have you read it" in asked[0]
    check_code_named(place, {})
    assert len(asked) == 3


@pytest.mark.parametrize(
    ("settings", "code"),
    [
        ({"cycles": ["a.py", "b"]}, ["a.py"]),
        ({"detectors": {"A": "x.py", "B": {"use": "y"}}}, ["x.py"]),
        (
            {"closed_loop": {"effects": ["e.py"], "allow_code": True}},
            ["closed_loop.allow_code: True", "e.py"],
        ),
        ({"allow_code": ["m.py"]}, ["m.py"]),
        ({"allow_code": "yes"}, ["allow_code: yes"]),
        ({"allow_code": "no", "detectors": 3, "cycles": "x.py"}, []),
    ],
)
def test_code_of_a_configuration_is_listed(settings, code):
    assert list_code(settings) == code


def test_a_change_leaves_the_rest_of_its_section():
    assert merge({"snr": {"runs": 1, "f0": 2}, "seed": 1}, {"snr": {"runs": 3}}) == {
        "snr": {"runs": 3, "f0": 2}, "seed": 1,
    }  # fmt: skip
