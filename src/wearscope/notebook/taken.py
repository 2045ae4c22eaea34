"""Recordings as a caller has them: a folder, or data frames and the robot's URDF."""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeAlias

import pandas as pd

from wearscope.errors import InputError
from wearscope.starters.conversion import convert_recordings
from wearscope.starters.dataset import write_dataset
from wearscope.starters.mapped import Mapped

#: Data frames by the names that their runs get.
Frames: TypeAlias = pd.DataFrame | Sequence[pd.DataFrame] | Mapping[str, pd.DataFrame]


def check_options(call: str, given: Mapping[str, Any], known: Sequence[str]) -> None:
    """Refuse an option that a call does not have.

    Raises
    ------
    InputError
    """
    for name in given:
        if name not in known:
            raise InputError(f"{call}: has no option '{name}'; it has {', '.join(sorted(known))}.")


@contextmanager
def take_recordings(
    recordings: str | Path | Frames,
    urdf: str | Path | None,
    reference: Sequence[str] = (),
    **stated: Any,
) -> Iterator[Path]:
    """Folder of a data set: the one that is named, or one that is made of data frames for as long as needed.

    Parameters
    ----------
    recordings : path-like, DataFrame, or sequence or mapping of DataFrame
        Columns are guessed as by ``wearscope new dataset``. Of several runs the last is only scored, unless
        ``test`` names others; runs of a sequence are called ``run1``, ``run2``, ...
    urdf : path-like or None
        Of the robot; needed with data frames.
    reference : sequence of str
        Sessions in which the machine was healthy; each run is a session of its name where ``sessions`` does
        not say otherwise.
    **stated
        Fields of `wearscope.starters.mapped.Mapped`.

    Raises
    ------
    InputError
        Where there is nothing to read, or the data frames cannot be understood.
    """
    if isinstance(recordings, str | Path):
        if urdf is not None or stated or reference:
            raise InputError(f"{recordings}: a folder says all of that itself; give data frames with a URDF.")
        yield Path(recordings)
        return
    frames = _name_frames(recordings)
    if urdf is None:
        raise InputError("recordings: data frames need the robot's URDF; give urdf='arm.urdf'.")
    check_options("recordings", stated, [field.name for field in fields(Mapped)])
    with tempfile.TemporaryDirectory() as place:
        files = []
        for name, frame in frames.items():
            files.append(Path(place) / f"{name}.parquet")
            frame.to_parquet(files[-1], index=False)
        mapped = Mapped(**stated, reference=reference)
        folder = Path(place) / "recordings"
        folder.mkdir()
        write_dataset(folder, "recordings", Path(urdf), convert_recordings(files, Path(urdf), mapped), mapped)
        yield folder


def _name_frames(recordings: Frames) -> dict[str, pd.DataFrame]:
    """Data frames by name.

    Raises
    ------
    InputError
    """
    if isinstance(recordings, pd.DataFrame):
        recordings = [recordings]
    if not isinstance(recordings, Mapping):
        if not isinstance(recordings, Sequence):
            kind = type(recordings).__name__
            raise InputError(f"recordings: a {kind} is none; give a folder, or data frames and a URDF.")
        recordings = {f"run{k}": frame for k, frame in enumerate(recordings, start=1)}
    for name, frame in recordings.items():
        if not isinstance(frame, pd.DataFrame):
            raise InputError(f"recordings: '{name}' is a {type(frame).__name__}; give a data frame.")
    if not recordings:
        raise InputError("recordings: there is none; give a folder, or data frames and a URDF.")
    return {str(name): frame for name, frame in recordings.items()}
