"""Whatever files from someone else hold, a command ends soon, in a result or one sentence, and runs no code.

Each command is a process with bounds. Fifty inputs a command run with the rest of the tests (two of slow
commands, which get their fifty with `make test-slow`), and 2,000 with `make test-kills`. Every input is made
from its number alone, so that one that fails can be made again.
"""

import os
from pathlib import Path

import click
import hostile
import pytest
from hostile import runner

from wearscope.cli.main import wearscope

#: Commands of which fifty inputs take longer than some seconds of processor.
SLOWER = (
    "check dataset",
    "check effect",
    "check servo",
    "compare loops",
    "compare studies",
    "evaluate",
    "history",
    "lerobot",
    "new dataset",
    "bag",
    "new robot",
)


def count_inputs():
    """Subject and number of inputs: a few, fifty, and two thousand, each in its tier."""
    for name in hostile.SUBJECTS:
        starting = name in hostile.STARTING  # the workflow, which takes seconds an input
        if not starting:
            yield pytest.param(name, 2 if name in SLOWER else 50)
        if starting or name in SLOWER:
            yield pytest.param(name, 10 if starting else 50, marks=pytest.mark.slow)
        yield pytest.param(name, 100 if starting else 2000, marks=pytest.mark.long)


@pytest.fixture(scope="module")
def run():
    with hostile.Runner() as runner:
        yield runner


@pytest.mark.parametrize(("name", "count"), [*count_inputs()])
def test_no_input_runs_code_hangs_or_ends_in_a_traceback(run, name, count, tmp_path):
    wrong = []
    for number in range(count):
        folder = tmp_path / str(number) / "here"
        folder.mkdir(parents=True)
        case = hostile.make_case(name, number, folder)
        outcome = run(case.arguments, folder, case.around)
        if told := hostile.judge(case.made, outcome, folder, case.around):
            wrong.append(f"{number}: {case.told}: {told}")
    assert not wrong, "\n".join(wrong)


def list_commands(group, way=()):
    """Names of all commands below a group."""
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        inner = isinstance(command, click.Group)
        yield from list_commands(command, (*way, name)) if inner else [" ".join((*way, name))]


def test_every_command_is_tried():
    """A command that is new needs inputs, or has to be listed as one that reads no file."""
    tried = {" ".join(one.arguments) for one in hostile.SUBJECTS.values()}
    for command in list_commands(wearscope):
        assert command in hostile.FILELESS or any(f"{one} ".startswith(f"{command} ") for one in tried), (
            command
        )


@pytest.mark.parametrize("name", [name for name in hostile.SUBJECTS if name not in hostile.STARTING])
def test_sound_inputs_are_accepted(run, name, tmp_path):
    """So that it is what was spoiled that is refused."""
    folder = tmp_path / "here"
    folder.mkdir()
    subject = hostile.SUBJECTS[name]
    subject.write(folder)
    outcome = run(subject.arguments, folder)
    assert outcome.code == 0, outcome.output


@pytest.mark.parametrize(
    ("outcome", "left", "told"),
    [
        (hostile.Outcome(0, "well.\n", 1.0, 1), None, ""),
        (hostile.Outcome(1, "a.csv: holds 0 rows; record more.\n", 1.0, 1), None, ""),
        (hostile.Outcome(98, "ValueError", 1.0, 1), None, "exit status 98"),
        (hostile.Outcome(-9, "", 1.0, 1), None, "exit status -9"),
        (hostile.Outcome(0, "well.\n", 11.0, 1), None, "11.0 s"),
        (hostile.Outcome(0, "well.\n", 1.0, 3 << 30), None, "1.0 s, 3.00 GiB"),
        (hostile.Outcome(0, "\x1b[2J\n", 1.0, 1), None, "steers the terminal"),
        (hostile.Outcome(1, "\n", 1.0, 1), None, "ends without a word"),
        (hostile.Outcome(1, "no rows\n", 1.0, 1), None, "says no sentence"),
        (hostile.Outcome(1, "no.\n", 1.0, 1), "made", "leaves made"),
        (hostile.Outcome(0, "well.\n", 1.0, 1), hostile.RAN, "code ran"),
    ],
)
def test_a_command_that_ends_ill_would_be_found(outcome, left, told, tmp_path):
    if left:
        (tmp_path / left).touch()
    found = hostile.judge(("made",), outcome, tmp_path)
    assert found.startswith(told) and bool(found) == bool(told)


def test_a_process_is_ended_where_it_takes_too_long_or_too_much(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "WAITED", 1)
    monkeypatch.setattr(runner, "act", lambda *given: (os.setsid(), os.read(os.pipe()[0], 1)))
    Path(f"{tmp_path}.said").touch()
    assert runner.run_forked([], str(tmp_path)).code < 0
