"""What commands print cannot steer the terminal."""

import re
from pathlib import Path

import click
from click.testing import CliRunner

import wearscope.cli
from wearscope.cli.main import wearscope as command
from wearscope.cli.progress import say
from wearscope.cli.show import print_table


def test_a_path_is_shown_without_control_characters(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(command, ["new", "example", "odd\x1b[31m\n"], catch_exceptions=False)
    assert done.exit_code == 0 and "odd\\x1b[31m\\n" in done.output and "\x1b" not in done.output


def test_a_line_stays_one(capsys):
    say("a\r\nb\tc\x07é")
    assert capsys.readouterr().out == "a\\r\\nb\\tc\\x07é\n"


def test_a_table_folds_into_the_terminal_and_steers_nothing(capsys, monkeypatch):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", "40")
    print_table(("name", "what"), [("a\x1b[31mb", "word " * 20), ("c", "")])
    told = click.unstyle(capsys.readouterr().out)
    lines = told.splitlines()
    assert max(map(len, lines)) <= 40 and len(lines) == 6
    assert told.count("word") == 20 and "\x1b" not in told and "a\\x1b[31mb" in told
    assert lines[-1].rstrip() == "c"


def test_every_command_prints_by_it():
    for file in Path(wearscope.cli.__path__[0]).glob("*.py"):
        found = len(re.findall(r"click\.s?echo\(", file.read_text()))
        assert found == (file.name == "progress.py"), file.name
