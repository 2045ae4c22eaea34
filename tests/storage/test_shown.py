"""An answer is shown as a whole: the old one or the new one, at whatever step its writer is killed."""

import os
import shutil

import pytest

from wearscope.cli.workflow import wait_turn
from wearscope.storage import files as shown
from wearscope.storage.files import CHECKSUMS, LIST, MADE, DamagedFile, check_answer, forget_lost, show_answer

OLD = {"verdict.json": "1", "report.html": "<old>", "residual.parquet": "r", "drawn/after-01.yaml": "a"}
NEW = {"verdict.json": "2", "report.html": "<new>", "next_measurement_1.csv": "n", "drawn/after-01.yaml": "b"}


class Killed(BaseException):
    """The end of a process."""


def make(place, answer, study=False):
    """Where jobs have made an answer, and where it is shown; a study makes its own within itself."""
    folder = place / "loops" / "arm"
    made = folder / "parts" / "answer" if study else place / "loops" / MADE / "arm"
    shutil.rmtree(made, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in answer.items():
        (made / name).parent.mkdir(parents=True, exist_ok=True)
        (made / name).write_text(text)
    return made, folder


def read(folder):
    return {
        file.relative_to(folder).as_posix(): file.read_text()
        for file in folder.rglob("*")
        if file.is_file()
        and not any(part == "parts" or part.startswith(".") for part in file.relative_to(folder).parts)
    }


def test_a_new_answer_leaves_nothing_of_the_old_one(tmp_path):
    show_answer(*make(tmp_path, OLD))
    made, folder = make(tmp_path, NEW)
    (folder / "close_loop.log").write_text("said")
    show_answer(made, folder)
    assert read(folder) == NEW | {"close_loop.log": "said"}
    assert (made / LIST).is_file() and not list(folder.glob(".ready")) and not list(folder.glob(".gathered"))


@pytest.mark.parametrize("study", [False, True])
@pytest.mark.parametrize("step", range(1, 60))
def test_killed_at_any_step_it_is_whole_once_somebody_looks(tmp_path, monkeypatch, step, study):
    show_answer(*make(tmp_path, OLD, study))
    made, folder = make(tmp_path, NEW, study)
    left = [step]

    def kill_at(call):
        def called(*given, **named):
            left[0] -= 1
            if not left[0]:
                raise Killed
            return call(*given, **named)

        return called

    with monkeypatch.context() as patch:
        for module, name in ((os, "replace"), (os, "unlink"), (os, "mkdir"), (shutil, "copyfile")):
            patch.setattr(module, name, kill_at(getattr(module, name)))
        try:
            show_answer(made, folder)
        except Killed:
            pass
    begun = (folder / ".ready").is_dir()
    if not begun and read(folder) != NEW:
        assert read(folder) == OLD
    check_answer(folder / "report.html")
    assert read(folder) in (OLD, NEW) and (read(folder) == NEW or not begun)
    show_answer(made, folder)
    assert read(folder) == NEW


def test_a_study_keeps_its_tables_and_checksums_next_to_its_answer(tmp_path):
    made, folder = make(tmp_path, {"conclusion.json": "1", "report.html": "<new>"}, study=True)
    (folder / CHECKSUMS).mkdir()
    for name in ("snr.parquet", "report.html"):
        (folder / name).write_text("old")
    show_answer(made, folder)
    assert read(folder) == {"conclusion.json": "1", "report.html": "<new>", "snr.parquet": "old"}
    kept = (folder / CHECKSUMS / "conclusion.json.sha256").read_text()
    assert kept.endswith("  conclusion.json\n") and not (folder.parent / CHECKSUMS).exists()
    check_answer(folder / "report.html")


def test_what_is_lost_or_changed_afterwards_is_told_and_made_again(tmp_path):
    made, folder = make(tmp_path, NEW)
    show_answer(made, folder)
    assert (folder.parent / CHECKSUMS / "arm" / "report.html.sha256").is_file()
    forget_lost(made, folder)
    assert (made / LIST).is_file()
    (folder / "report.html").write_text("<edited>")
    with pytest.raises(DamagedFile, match="is not what was written"):
        check_answer(folder / "report.html")
    (folder / "report.html").unlink()
    forget_lost(made, folder)
    assert not (made / LIST).is_file()
    show_answer(made, folder)
    assert read(folder) == NEW


def test_an_answer_from_before_lists_were_kept_gives_its_place(tmp_path):
    made, folder = make(tmp_path, NEW)
    for name in ("report.html", "signals.parquet", "next_measurement_4.csv", "close_loop.log"):
        (folder / name).write_text("old")
    show_answer(made, folder)
    assert set(read(folder)) == {*NEW, "close_loop.log"}
    assert shown.READY not in os.listdir(folder)


def test_what_a_run_makes_just_now_is_said(tmp_path):
    made, folder = make(tmp_path, NEW)
    show_answer(made, folder)
    (folder / "verdict.json").unlink()
    with pytest.raises(DamagedFile, match="though it was written; make it again"):
        check_answer(folder / "report.html")
    with wait_turn(tmp_path / "study", print):
        (tmp_path / "loops").rename(tmp_path / "study" / "results" / "loops")
        with pytest.raises(DamagedFile, match="is being made; look again when the run has ended"):
            check_answer(tmp_path / "study" / "results" / "loops" / "arm" / "report.html")
        (tmp_path / "study" / "results" / "loops" / "arm" / "verdict.json").write_text(NEW["verdict.json"])
        check_answer(tmp_path / "study" / "results" / "loops" / "arm" / "report.html")
