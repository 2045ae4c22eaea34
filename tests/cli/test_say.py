"""What commands print cannot steer the terminal."""

import re
from pathlib import Path

from click.testing import CliRunner

import wearscope.cli
from wearscope.cli.main import wearscope as command
from wearscope.cli.say import say


def test_a_path_is_shown_without_control_characters(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(command, ["new", "example", "odd\x1b[31m\n"], catch_exceptions=False)
    assert done.exit_code == 0 and "odd\\x1b[31m\\n" in done.output and "\x1b" not in done.output


def test_a_line_stays_one(capsys):
    say("a\r\nb\tc\x07é")
    assert capsys.readouterr().out == "a\\r\\nb\\tc\\x07é\n"


def test_every_command_prints_by_it():
    """The completion prints a script of several lines."""
    for file in Path(wearscope.cli.__path__[0]).glob("*.py"):
        if file.name not in ("say.py", "completion.py"):
            assert not re.search(r"click\.s?echo\(", file.read_text()), file.name
