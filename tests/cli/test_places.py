"""Places that the system refuses, streams that are closed and memory that runs out end in a sentence."""

import errno
import os
import re
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from calls import call, call_python
from hostile.samples import write_dataset, write_loop, write_robot, write_shown

from wearscope import processes
from wearscope.cli import main

COMMAND = (sys.executable, "-P", "-m", "wearscope")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("places")
    write_robot(folder / "arm")
    write_dataset(folder / "data")
    for name in ("a", "b"):
        write_loop(folder / name)
    write_shown(folder, "csv")
    (folder / "file").write_text("x")
    return folder


def run(folder, line, **given):
    return call(*COMMAND, *line.split(), folder=folder, errors="replace", timeout=120, **given)


@pytest.mark.parametrize(
    "line",
    [
        "new study file/s --robot arm",
        "new robot arm/robot.urdf --name r --in file",
        "new dataset data/a.csv data/b.parquet --urdf data/robot.urdf --in /proc/none --name d",
        "check file/x",
        "history file",
        "show file/x.csv",
        "demo --out file/x",
        "evaluate arm data --temperature 40 --out file/x",
        "diagnose file/data",
    ],
)  # fmt: skip
def test_a_place_that_is_refused_gets_a_sentence(place, line):
    """At once, not when what is to be written there has been computed."""
    done = run(place, line)
    assert done.returncode in (1, 2) and "Traceback" not in done.stderr, done.stderr
    assert done.stderr.strip() and (place / "file").read_text() == "x"
    assert "Comparing" not in done.stderr and "RMS" not in done.stdout


def make_detector(folder, **options):
    done = run(folder, f"new detector own --in {folder}", **options)
    assert done.returncode == 0 and "Traceback" not in done.stderr
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.fixture(scope="module")
def detector(tmp_path_factory):
    return make_detector(tmp_path_factory.mktemp("open"))


@pytest.mark.parametrize("closed", [(0,), (1,), (2,), (1, 2), (0, 1, 2)])
def test_streams_that_are_closed_change_nothing(detector, closed, tmp_path):
    """A file that is opened next would be the standard output, which libraries write to."""

    def close():
        for handle in closed:
            os.close(handle)

    assert make_detector(tmp_path, preexec_fn=close) == detector


def test_a_reader_that_leaves_is_no_defect(place):
    with subprocess.Popen([*COMMAND, "show", "a.csv"], cwd=place, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE) as done:  # fmt: skip
        done.stdout.close()
        assert b"Traceback" not in done.stderr.read()


def test_names_that_are_no_text_and_folders_that_are_gone_are_told(place, tmp_path):
    odd = os.fsdecode(b"\xff\xfe.csv")
    for line in (f"show {odd}", f"check {odd}", f"new dataset {odd} --urdf arm/robot.urdf"):
        done = run(place, line)
        assert done.returncode == 1 and "is not UTF-8; rename the file or folder." in done.stderr
    gone = tmp_path / "gone"
    gone.mkdir()
    code = f"import os, sys; os.rmdir({str(gone)!r}); os.execv(sys.executable, {[*COMMAND, 'check']!r})"
    done = call_python("-c", code, folder=gone)
    assert done.returncode == 1 and done.stderr.strip() == (
        "the working directory is gone; change to another one."
    )


@pytest.mark.parametrize(
    ("error", "status", "told"),
    [
        (MemoryError(), 1, "memory ran out; free some.*\n"),
        *(
            # Such errors name no file.
            (OSError(number, os.strerror(number)), 1, f"{os.strerror(number)}; raise the limit of .*\n")
            for number in (errno.EMFILE, errno.EAGAIN)
        ),
        (
            OSError(errno.ENOSPC, "No space left on device", "/nowhere/x"),
            1,
            r"/nowhere/x: the disk at / is full .*; free disk space there\.\n",
        ),
        (KeyboardInterrupt(), 130, "Interrupted.\n"),
    ],
)
def test_what_ends_a_command_while_its_modules_are_imported_is_told(error, status, told, monkeypatch, capsys):
    def fail(group, context, name):
        raise error

    monkeypatch.setattr(main.LazyGroup, "get_command", fail)
    monkeypatch.setattr(main, "end_process", sys.exit)
    monkeypatch.setattr(sys, "argv", ["wearscope", "check"])
    with pytest.raises(SystemExit) as end:
        main.main()
    assert end.value.code == status and re.fullmatch(told, capsys.readouterr().err)


@pytest.mark.parametrize("lasting", [[], ["package"], ["cache"]])
def test_functions_are_compiled_where_no_lasting_place_can_be_written(lasting, tmp_path, monkeypatch):
    """As another user who has no home, in a container for example."""
    (tmp_path / "home").mkdir()
    places = {"package": Path(processes.__file__).parent, "cache": tmp_path / "home"}
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home" / "none" / "yet"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(processes.tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(processes.os, "access", lambda place, mode: place in [places[one] for one in lasting])
    left = []
    monkeypatch.setattr(
        processes.atexit, "register", lambda *call, **given: left.append(partial(*call, **given))
    )
    processes.keep_compiled()
    made = os.environ.get("NUMBA_CACHE_DIR")
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    assert (made is None) == bool(lasting) and len(left) == (not lasting)
    if made:
        assert Path(made).stat().st_mode & 0o777 == 0o700 and Path(made).parent == tmp_path
        left[0]()
        assert not Path(made).exists()
