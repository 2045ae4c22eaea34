"""What is shown is what was computed: commands check the digest of what they show, where one is kept."""

import json

import pytest
from click.testing import CliRunner
from hostile.samples import write_loop

from wearscope import integrity
from wearscope.cli.main import wearscope
from wearscope.errors import InputError
from wearscope.storage.files import record_checksums


@pytest.fixture
def loops(tmp_path, monkeypatch):
    """Two loops in a folder that keeps their checksums."""
    folder = tmp_path / "results" / "closed_loop"
    for name in ("a", "b"):
        write_loop(folder / name)
        record_checksums(folder, (folder / name).iterdir())
    monkeypatch.chdir(tmp_path)
    return folder


def run(*arguments):
    done = CliRunner().invoke(wearscope, arguments)
    assert done.exception is None or isinstance(done.exception, InputError | SystemExit), done.exception
    return done.output + str(done.exception or "")


def change(path):
    path.write_bytes(path.read_bytes().replace(b"1.0", b"0.5").replace(b"so.", b"no.") + b" ")


@pytest.mark.parametrize(
    ("name", "commands"),
    [
        ("verdict.json", ["report {}", "show {}/verdict.json", "compare {} {}", "history results"]),
        ("report.html", ["report {}", "history results"]),
        ("ranking.parquet", ["show {}/ranking.parquet"]),
    ],
)
def test_what_was_changed_is_told_in_place_of_shown(loops, name, commands):
    folder = "results/closed_loop/a"
    for command in commands:
        assert "checksum" not in run(*command.format(folder, "results/closed_loop/b").split())
    change(loops / "a" / name)
    for command in commands:
        said = " ".join(run(*command.format(folder, "results/closed_loop/b").split()).split())
        assert f"{name}: is not what was written (its checksum differs)" in said, (command, said)


def test_a_page_whose_answer_is_lost_is_not_shown(loops):
    (loops / "a" / "verdict.json").unlink()
    said = run("report", "results/closed_loop/a")
    assert "verdict.json: no such file, though it was written; make it again." in said
    assert "It is so." not in said
    assert "It is so." in run("report", "results/closed_loop/b")


def test_the_history_goes_on_without_the_page_that_is_damaged(loops):
    change(loops / "a" / "verdict.json")
    assert "damaged" in run("history", "results") and "It is so." in run("history", "results")
    change(loops / "b" / "report.html")
    assert "It is so." not in run("history", "results")


def test_lines_of_a_kept_history_that_are_none_are_left_out(loops):
    """The file may be somebody else's."""
    kept = loops.parent / "history.jsonl"
    strip = {"answer": "It was so.", "kind": "good", "sure": "", "caveat": "", "action": ""}
    good = {"kind": "diagnosis", "name": "old", "when": "2026-01-01 00:00:00", "strip": strip, "digest": "0"}
    odd = [{**good, name: value} for name, value in (("when", 3), ("values", {"a": "x"}), ("strip", {}))]
    lines = [good, *odd, 3, None, [good], {}, "x"]
    kept.write_bytes("\n".join(map(json.dumps, lines)).encode() + b"\n\xff\n" + b"[" * 5000 + b"\n{")
    said = run("history", "results")
    assert said.count("It was so.") == 1 and said.count("It is so.") == 2
    kept.unlink()
    kept.symlink_to("/dev/zero")
    assert "history.jsonl: is no plain file; move it away." in run("history", "results")


def test_integrity_of_what_has_no_checksums_is_not_content(loops, tmp_path, capsys):
    assert integrity.main([str(loops)]) == 0
    assert "6 files, every checksum holds" in capsys.readouterr().out
    for folder in (loops / "a", tmp_path):
        assert integrity.main([str(folder)]) == 1
        said = capsys.readouterr()
        assert "holds no checksums" in said.err and "holds\n" not in said.out
