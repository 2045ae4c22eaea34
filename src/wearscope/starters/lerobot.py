"""Reads data sets of LeRobot: ``meta/info.json``, and Parquet files with one row for each frame."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, Field, ValidationError

from wearscope import limits
from wearscope.errors import InputError, describe, explain_breach
from wearscope.storage.files import DamagedFile, read_json
from wearscope.storage.tables import check_unpacked

#: Kind of signal by feature; the name of a single value, such as ``shoulder.vel``, may state another kind.
_FEATURES = {
    "observation.state": "position",
    "observation.velocity": "velocity",
    "observation.effort": "effort",
    "observation.torque": "effort",
    "observation.current": "current",
    "observation.load": "load",
    "action": "goal_position",
}
#: Kind by the end of a single value's name, such as ``shoulder.pos``.
_ENDS = {"pos": "position", "vel": "velocity", "torque": "effort", "effort": "effort", "current": "current"}
#: Largest position where positions are per cent of a joint's range.
_PER_CENT = 100.0
#: Kinds that tell the torque.
_MEASURED = {"effort", "current", "load"}


class _Feature(BaseModel):
    """A feature of the table's rows, as `meta/info.json` describes it."""

    shape: list[Annotated[int, Field(ge=0, le=limits.COLUMNS)]] = Field(min_length=1)
    names: Any = None


class _Info(BaseModel):
    """The fields of ``meta/info.json`` that are used here."""

    features: dict[str, _Feature]


def is_lerobot(path: Path) -> bool:
    """Return whether a folder is a data set of LeRobot."""
    return (path / "meta" / "info.json").is_file()


def read_lerobot(path: Path, servo: bool = False) -> list[tuple[str, pd.DataFrame]]:
    """Read the episodes of a data set: name, and table with ``timestamp`` [s] and ``<joint>.<kind>``.

    Parameters
    ----------
    path : Path
        Folder of the data set, format 2 or 3.
    servo : bool
        Whether the torque is computed from a servo's law, so that the data set needs no effort.

    Raises
    ------
    InputError
        Where the data set cannot be read, or has no positions, or none of effort, current and load.
    """
    features = _read_features(path)
    columns = _name_columns(features)
    kinds = {name.rpartition(".")[2] for names in columns.values() for name in names}
    if "position" not in kinds:
        raise InputError(f"{path}: has no observation.state; its features are {', '.join(features)}.")
    if not servo and not kinds & _MEASURED:
        raise InputError(
            f"{path}: holds no effort, torque or current (features: {', '.join(features)}); record them, or "
            "give the servo's law with --servo."
        )
    files = sorted((path / "data").rglob("*.parquet"))
    if not files:
        raise InputError(f"{path}: has no Parquet files under data; download the data set whole.")
    wanted = ["timestamp", "episode_index", *columns]
    try:
        if sum(map(check_unpacked, files)) > limits.UNPACKED_BYTES:
            told = f"take more than {limits.UNPACKED_BYTES / 1e9:g} GB of memory together"
            raise InputError(f"{path}: its Parquet files {told}; download fewer episodes.")
        tables = [pq.read_table(file, columns=wanted, partitioning=None) for file in files]
        table = pa.concat_tables(tables)
        parts = [_read_values(table, feature, len(names)) for feature, names in columns.items()]
        time, episode = (
            table[name].cast(kind).to_numpy()
            for name, kind in (("timestamp", pa.float64()), ("episode_index", pa.int64()))
        )
        if table["episode_index"].null_count:
            raise ValueError("episode_index has holes")
    except MemoryError:
        raise
    except (pa.ArrowException, OSError, ValueError, TypeError, AttributeError, KeyError) as error:
        if isinstance(error, InputError) and not isinstance(error, DamagedFile):
            raise
        raise InputError(
            f"{path}: cannot be read as a LeRobot data set ({describe(error)}); download it again."
        ) from error
    if not len(table):
        raise InputError(f"{path}: holds no rows; download the data set whole.")
    frame = pd.DataFrame(
        np.column_stack(parts), columns=[name for names in columns.values() for name in names]
    )
    frame.insert(0, "timestamp", time)
    numbers = np.unique(episode)
    if len(numbers) > limits.RUNS:
        raise InputError(f"{path}: has more than {limits.RUNS} episodes; download fewer of them.")
    return [(f"episode_{number:06d}", frame[episode == number].reset_index(drop=True)) for number in numbers]


def doubt_angles(path: Path, episodes: Sequence[tuple[str, pd.DataFrame]]) -> list[str]:
    """Return a note where positions may be per cent of the joints' ranges instead of angles; else nothing."""
    largest = max(
        float(frame.filter(regex=r"\.position$").abs().max(axis=None)) for _, frame in episodes if len(frame)
    )
    if not 4.0 * np.pi < largest <= _PER_CENT:
        return []
    return [
        f"{path.name}: no position exceeds {largest:.4g}. LeRobot records per cent of each joint's range "
        "where use_degrees is false, which are no angles; record with use_degrees=true then."
    ]


def _read_features(path: Path) -> dict[str, _Feature]:
    """Read the features that a data set states, by name."""
    file = path / "meta" / "info.json"
    try:
        return _Info.model_validate(read_json(file)).features
    except ValidationError as error:
        told = explain_breach(error)
        raise InputError(f"{file}: cannot be read ({told}); download the data set again.") from None


def _name_columns(features: dict[str, _Feature]) -> dict[str, list[str]]:
    """Name the values of each feature ``<joint>.<kind>``."""
    columns = {}
    for feature, kind in _FEATURES.items():
        if feature not in features:
            continue
        stated = features[feature].names
        if isinstance(stated, dict):
            stated = next((one for one in stated.values() if isinstance(one, list)), None)
        count = features[feature].shape[0]
        if not isinstance(stated, list) or len(stated) != count:
            stated = [f"joint_{k}" for k in range(count)]
        names = []
        for name in map(str, stated):
            joint, _, end = name.rpartition(".")
            own = _ENDS.get(end)
            if own is None:
                joint, own = name, "position"
            names.append(f"{joint}.{kind if own == 'position' else own}")
        if len(set(names)) == len(names):
            columns[feature] = names
    return columns


def _read_values(table: pa.Table, feature: str, count: int) -> np.ndarray:
    """Return the values (N, count) of a feature: a row holds a list, or a number where `count` is 1."""
    column = table[feature].combine_chunks()
    values = column.flatten() if pa.types.is_nested(column.type) else column
    return np.asarray(values.to_numpy(zero_copy_only=False), dtype=float).reshape(len(table), count)
