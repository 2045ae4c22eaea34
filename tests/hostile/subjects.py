# ruff: noqa: E501
"""The commands that read files, and the n-th spoiled input of each."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree

from hostile.bags import write_bag, write_odd_bag
from hostile.files import spoil_archive, spoil_code, spoil_place, spoil_urdf
from hostile.recordings import write_odd_recording
from hostile.runner import AROUND, RAN
from hostile.samples import (
    write_archive,
    write_dataset,
    write_lerobot,
    write_loop,
    write_own,
    write_ranking,
    write_robot,
    write_shown,
    write_study,
)
from hostile.tables import spoil_csv, spoil_parquet
from hostile.trees import spoil_bytes, spoil_json, spoil_yaml
from wearscope.storage.files import record_checksums

#: What spoils a file, by the end of its name; any other by its bytes.
SPOIL = {
    ".yaml": spoil_yaml, ".json": spoil_json, ".urdf": spoil_urdf, ".csv": spoil_csv, ".parquet": spoil_parquet,
    ".py": spoil_code, ".tar": spoil_archive,
}  # fmt: skip


@dataclass(frozen=True)
class Subject:
    """A command line that reads files: what makes sound ones in a folder, and those of them that are spoiled."""

    write: Callable[[Path], None]
    files: tuple[str, ...]
    line: str | tuple[str, ...]
    #: What it makes, which is there whole or not at all.
    made: tuple[str, ...] = ()

    @property
    def arguments(self) -> tuple[str, ...]:
        """Words of the command line."""
        return tuple(self.line.split()) if isinstance(self.line, str) else self.line


def _write(**made: Callable[[Path], None]) -> Callable[[Path], None]:
    """Makes each folder by its name."""

    def write(folder: Path) -> None:
        for name, one in made.items():
            one(folder / name)

    return write


def _write_results(folder: Path) -> None:
    folder.mkdir()
    write_archive(folder / "x.tar")
    write_shown(folder, "parquet")
    write_ranking(folder)


def _write_reevaluated(folder: Path) -> None:
    write_study(folder)
    write_robot(folder / "after")


def _write_checked(folder: Path) -> None:
    write_loop(folder / "results" / "a" / "loop")
    made = [*(folder / "results" / "a" / "loop").iterdir()]
    record_checksums(folder / "results" / "a", made)


_ARM = ("arm/model.yaml", "arm/robot.urdf")
_DATA = tuple(f"data/{one}" for one in ("dataset.yaml", "robot.urdf", "a.csv", "b.parquet"))
_ARM_AND_DATA, _DATA_SET = _write(arm=write_robot, data=write_dataset), _write(data=write_dataset)
_ARCHIVE = lambda folder: write_archive(folder / "a.tar")  # noqa: E731
_CONVERT = "new dataset data/a.csv data/b.parquet --urdf data/robot.urdf --name made --accept"
#: Each command with a file: what writes it, what of it is spoiled, the command line, what it makes.
SUBJECTS = {
    "check dataset": Subject(_DATA_SET, _DATA, "check data"),
    "check servo": Subject(lambda f: write_dataset(f / "data", True), _DATA[:1], "check data"),
    "check robot": Subject(_write(arm=write_robot), _ARM, "check arm"),
    "check study": Subject(write_study, ("config/config.yaml",), "check"),
    **{f"check {kind}": Subject(lambda f, kind=kind: write_own(f, kind), ("own.py",), "check own.py")
       for kind in ("detector", "effect", "cycle")},
    **{name: Subject(_DATA_SET, _DATA, f"{name} data -n") for name in ("diagnose", "track", "detect")},
    "run": Subject(write_study, ("config/config.yaml",), "run . -n"),
    "reevaluate": Subject(
        _write_reevaluated, ("config/config.yaml", *_ARM), "reevaluate . --before arm --after after/model.yaml -n"
    ),
    "export": Subject(_write(arm=write_robot), _ARM, "export arm -n"),
    "evaluate": Subject(_ARM_AND_DATA, (*_ARM, *_DATA), "evaluate arm data --temperature 40 --out made", ("made",)),
    "new robot": Subject(
        _write(arm=write_robot), ("arm/robot.urdf",), "new robot arm/robot.urdf --name made", ("made",)
    ),
    "new study": Subject(_write(arm=write_robot), _ARM, "new study made --robot arm", ("made",)),
    "new dataset": Subject(_DATA_SET, _DATA[1:], (*_CONVERT.split(), "unrelated tau"), ("made",)),
    "lerobot": Subject(
        _write(set=write_lerobot, arm=write_robot), ("set/meta/info.json", "set/data/a.parquet"),
        "new dataset set --urdf arm/robot.urdf --name made", ("made",),
    ),
    "bag": Subject(
        lambda f: (write_robot(f / "arm"), write_bag(f / "bag")), ("arm/robot.urdf",),
        (*"new dataset bag --urdf arm/robot.urdf --name made --accept".split(), "unrelated tau"), ("made",),
    ),
    "verify": Subject(_ARCHIVE, ("a.tar",), "archive verify a.tar"),
    "unpack": Subject(_ARCHIVE, ("a.tar",), "archive unpack a.tar made", ("made",)),
    "restore": Subject(_ARCHIVE, ("a.tar",), "archive restore a.tar .", ("results",)),
    "compare archives": Subject(
        lambda f: [write_archive(f / one) for one in ("a.tar", "b.tar")], ("a.tar",), "compare a.tar b.tar"
    ),
    "compare loops": Subject(_write(a=write_loop, b=write_loop), ("a/verdict.json", "b/verdict.json"), "compare a b"),
    "compare studies": Subject(
        _write(a=_write_results, b=_write_results), ("a/ranking.parquet", "a/a.parquet"), "compare a b"
    ),
    "history": Subject(
        _write(a=write_loop, b=write_loop), ("a/verdict.json", "a/report.html", "b/ranking.parquet"), "history .",
        ("history.html",),
    ),
    "report": Subject(_write(a=write_loop), ("a/report.html",), "report a"),
    **{f"show {kind}": Subject(lambda f, kind=kind: write_shown(f, kind), (f"a.{kind}",), f"show a.{kind} --rows 5")
       for kind in ("csv", "json", "parquet")},
    "integrity": Subject(
        _write_checked,
        ("results/a/loop/verdict.json", "results/a/.checksums/loop/verdict.json.sha256"), "integrity results/a --set-aside",
    ),
}  # fmt: skip
#: Commands that start the workflow, which takes seconds.
STARTING = ("diagnose", "track", "detect", "run", "reevaluate", "export")
#: Commands that read no file.
FILELESS = ("demo", "new cycle", "new detector", "new effect", "new example")


@dataclass(frozen=True)
class Case:
    """An input: what was done to it, the command line, and what it makes."""

    told: str
    arguments: tuple[str, ...]
    made: tuple[str, ...]
    around: str = ""


def make_case(name: str, number: int, folder: Path) -> Case:
    """Write the n-th input of a subject into an empty folder; equal numbers give equal inputs."""
    subject, draw = SUBJECTS[name], random.Random(f"{name} {number}")
    subject.write(folder)
    (folder / "evil.py").write_text(f"open({str(folder / RAN)!r}, 'w')\n")
    if name == "new dataset" and draw.random() < 0.6:
        odd, told = write_odd_recording(folder, draw)
        words = [f"./{odd}" if one == "data/a.csv" else one for one in subject.arguments]
        unit = draw.choice(["s", "ms", "us", "ns", "d"])
        return Case(
            told, (*words, *draw.choice([(), (), ("--time-unit", unit), ("--rate", "100")])), subject.made
        )
    if draw.random() < 0.08:
        around = draw.choice(list(AROUND))
        return Case(around, subject.arguments, subject.made, around)
    if name == "bag":
        rmtree(folder / "bag")
        return Case(write_odd_bag(folder, draw), subject.arguments, subject.made)
    path = folder / draw.choice(subject.files)
    if draw.random() < 0.08:
        told = spoil_place(path, draw)
    else:
        content, told = SPOIL.get(path.suffix, spoil_bytes)(path.read_bytes(), draw)
        path.write_bytes(content)
    return Case(f"{path.name}: {told}", subject.arguments, subject.made)
