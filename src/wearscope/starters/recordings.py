"""Reads recordings as tables: text, JSON, NumPy, MATLAB, Parquet, and ROS 2 bags with joint states."""

import csv
import gzip
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.io import loadmat, whosmat

from wearscope import limits
from wearscope.errors import InputError, describe, escape_text, need
from wearscope.processes import bound_memory
from wearscope.starters.lerobot import doubt_angles, is_lerobot, read_lerobot
from wearscope.starters.states import spread_states
from wearscope.starters.text_files import SIGNS, read_text
from wearscope.storage.files import check_plain
from wearscope.storage.plain_yaml import load_plain_yaml
from wearscope.storage.tables import check_unpacked, to_frame

#: Errors that readers raise on a damaged file.
_BROKEN = (
    OSError,
    EOFError,
    ValueError,
    TypeError,
    NotImplementedError,
    RuntimeError,
    zlib.error,
    zipfile.BadZipFile,
)
#: Message type of joint states.
JOINT_STATE = "sensor_msgs/msg/JointState"
_BAGS = (".mcap", ".db3", ".bag")
_TEXT = (".csv", ".txt", ".tsv", ".dat", ".log")
_JSON = (".jsonl", ".ndjson", ".json")
_ARRAYS = (".npz", ".mat")
_PACKED = (".gz", ".zip")
#: MATLAB classes of variables that contain other variables.
_NESTED = ("struct", "cell", "object")


def read_recording(
    path: Path, topic: str | None = None, columns: Sequence[str] = ()
) -> tuple[pd.DataFrame, list[str]]:
    """Read a recording; return its table, and notes on how it was read.

    Parameters
    ----------
    path : Path
        A text, JSON, NumPy, MATLAB or Parquet file, an MCAP file, or the folder of a ROS 2 bag.
    topic : str, optional
        Topic of the joint states in a bag; by default the one with most messages.
    columns : sequence of str, optional
        Names of the columns, for a text file without names.

    Raises
    ------
    InputError
        Where the file is none of these, or cannot be read.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file; correct the name.")
    with bound_memory(path):
        frame, told = _read(path, topic, columns)
        return _settle(frame, path), told


def _settle(frame: pd.DataFrame, path: Path) -> pd.DataFrame:
    """Return the table with printable column names and native number types, as the later steps need it.

    Raises
    ------
    InputError
        Where it has fewer than two rows or too many columns, a name is too long or occurs twice, or a cell
        holds anything but a number, text, date or plain list of these.
    """
    if len(frame) < 2 or len(frame.columns) > limits.COLUMNS:
        few = "holds fewer than two rows" if len(frame) < 2 else f"has more than {limits.COLUMNS} columns"
        raise InputError(f"{path}: {few}; record it again with a row a sample, or leave it out.")
    columns = {}
    for k, name in enumerate(map(escape_text, map(str, frame.columns))):
        if len(name) > limits.COLUMN or name in columns:
            told = (
                f"has more than {limits.COLUMN} characters" if len(name) > limits.COLUMN else "stands twice"
            )
            raise InputError(f"{path}: column '{name[:30]}' {told}; rename it, or leave it out.")
        x = frame.iloc[:, k]
        if isinstance(x.dtype, pd.CategoricalDtype):  # values are stored once, and each row as an index
            x = pd.Series(np.asarray(x), frame.index)
        if isinstance(x.dtype, np.dtype) and x.dtype.kind in "iuf":
            x = x.astype(np.float64 if x.dtype.kind == "f" else x.dtype.newbyteorder("="))
        elif x.dtype.kind in "cV" or x.map(_is_deep).any():
            told = "holds bytes, or values of several or named parts"
            raise InputError(f"{path}: column '{name}' {told}; give each a column of its own.")
        elif x.dtype.kind == "O":
            x = x.map(lambda cell: cell.translate(SIGNS) if isinstance(cell, str) else cell)
        columns[name] = x
    return pd.DataFrame(columns, index=frame.index)


def _is_deep(cell: object) -> bool:
    """Return whether a cell holds bytes, a mapping or a nested list."""
    if isinstance(cell, list | tuple | np.ndarray):
        return any(isinstance(one, dict | list | tuple | np.ndarray) for one in cell)
    return isinstance(cell, dict | bytes)


def _read(path: Path, topic: str | None, columns: Sequence[str]) -> tuple[pd.DataFrame, list[str]]:
    kind = path.suffix.lower()
    if path.is_dir() or kind in _BAGS:
        return _read_bag(path, topic)
    try:
        if kind == ".parquet":
            check_unpacked(path)
            return to_frame(pq.read_table(path, partitioning=None), path), []
        if kind in _PACKED:
            with tempfile.TemporaryDirectory() as folder:
                inner = _unpack(path, Path(folder))
                try:
                    return _read(inner, topic, columns)
                except InputError as error:
                    raise InputError(str(error).replace(str(inner), str(path))) from None
        if kind in (*_TEXT, *_JSON, *_ARRAYS):
            check_plain(path, limits.TABLE_BYTES, "give a recording, in several files where it is large")
        if kind in _TEXT:
            return read_text(path, columns)
        if kind in _JSON:
            return pd.read_json(path, lines=kind != ".json", dtype=False), []
        if kind == ".npz":
            return _number_columns(_load_named(path)), []
        if kind == ".mat":
            arrays, notes = _load_matlab(path)
            return _number_columns(arrays), notes
    except (InputError, MemoryError):
        raise
    except (*_BROKEN, csv.Error, pa.ArrowException, pd.errors.ParserWarning) as error:
        told = describe(error)
        if told.endswith("out of memory"):  # pandas raises its own error with this message
            raise MemoryError from None
        raise InputError(f"{path}: cannot be read as a table ({told}); save it as CSV again.") from error
    raise InputError(
        f"{path}: is no recording that is known; give {', '.join(_TEXT)} (or one of them as "
        f"{' or '.join(_PACKED)}), {', '.join((*_JSON, *_ARRAYS))}, .parquet, .mcap or "
        "a bag; save another kind as CSV."
    )


def _load_named(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an ``.npz`` file by name."""
    loaded = np.load(path, allow_pickle=False)
    if isinstance(loaded, np.ndarray):
        raise InputError(f"{path}: holds one array without a name; write it with numpy.savez.")
    with loaded as arrays:
        return dict(arrays.items())


def _load_matlab(path: Path) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the longest numeric arrays of a ``.mat`` file, samples first, and a note on the others.

    An array within a structure is named after both, as ``structure_array``.
    """
    found: dict[str, np.ndarray] = {}
    try:
        if any(kind in _NESTED and np.prod(shape) > limits.COLUMNS for _, shape, kind in whosmat(path)):
            raise ValueError(f"a structure has more than {limits.COLUMNS} entries")
        left: list[tuple[str, Any]] = [("", loadmat(path, simplify_cells=True))]
    except MemoryError:
        raise
    except Exception as error:  # the reader raises many kinds of errors on a broken file
        raise ValueError(str(error)) from error
    while left:
        name, x = left.pop()
        if isinstance(x, Mapping):
            left += [(f"{name}_{key}".lstrip("_"), one) for key, one in reversed(list(x.items()))]
        elif isinstance(x, np.ndarray) and x.dtype.kind in "biuf":
            found[name] = x.T if x.ndim == 2 and x.shape[0] < x.shape[1] else x
    longest = max(map(len, found.values()), default=0)
    others = [name for name, x in found.items() if len(x) < longest]
    told = f"{path.name}: arrays with fewer than {longest} samples are left out: {', '.join(others)}."
    return {name: x for name, x in found.items() if name not in others}, [told] * bool(others)


def _number_columns(arrays: Mapping[str, np.ndarray]) -> pd.DataFrame:
    """Return a table of arrays (N,) and (N, n); the columns of the latter are numbered from 1."""
    columns: dict[str, np.ndarray] = {}
    for name, x in arrays.items():
        many = list(np.atleast_2d(x.T)) if x.ndim in (1, 2) else []
        columns |= {f"{name}_{k + 1}" if x.ndim == 2 else name: one for k, one in enumerate(many)}
    return pd.DataFrame(columns)


def _unpack(path: Path, folder: Path) -> Path:
    """Unpack the single file in a packed file, up to the allowed size; return its path."""
    check_plain(path, limits.TABLE_BYTES, "give a recording, in several files where it is large")
    with ExitStack() as stack:
        name = path.stem
        if path.suffix.lower() == ".zip":
            archive = stack.enter_context(zipfile.ZipFile(path))
            inner = [one for one in archive.namelist() if not one.endswith("/") and "__MACOSX" not in one]
            if len(inner) != 1:
                raise InputError(f"{path}: holds {len(inner)} files; unpack it, and give the recordings.")
            packed: IO[bytes] = stack.enter_context(archive.open(inner[0]))
            name = Path(inner[0]).name
        else:
            packed = cast(IO[bytes], stack.enter_context(gzip.GzipFile(path)))
        if Path(name).suffix.lower() not in (*_TEXT, ".parquet"):
            raise InputError(f"{path}: holds '{name}', which is no table; unpack it, and give a recording.")
        target = stack.enter_context((folder / name).open("wb"))
        left = limits.TABLE_BYTES
        while block := packed.read(1 << 20):
            left -= len(block)
            if left < 0:
                raise InputError(f"{path}: is larger than a table may be when unpacked; split it.")
            target.write(block)
    return folder / name


def open_recordings(
    files: Sequence[Path], topic: str | None = None, servo: bool = False, columns: Sequence[str] = ()
) -> Iterator[tuple[Path, pd.DataFrame, list[str]]]:
    """Yield path, table and notes of each recording; an episode of a LeRobot data set is a recording.

    Parameters
    ----------
    files : sequence of Path
        Files that `read_recording` reads, or folders of LeRobot data sets.
    topic : str, optional
        Topic of the joint states in a bag.
    servo : bool
        Whether the torque is computed from a servo's law, so that no effort is needed.
    columns : sequence of str, optional
        Names of the columns, for text files without names.
    """
    for file in files:
        if is_lerobot(file):
            with bound_memory(file):
                episodes = read_lerobot(file, servo)
            told = doubt_angles(file, episodes)
            for name, frame in episodes:
                yield file / name, frame, told
                told = []
        else:
            frame, told = read_recording(file, topic, columns)
            yield file, spread_states(frame), told


def _read_bag(path: Path, topic: str | None) -> tuple[pd.DataFrame, list[str]]:
    """Read a bag's joint states: ``time`` [s] and ``<joint>.position``, ``.velocity``, ``.effort``."""
    need("rosbags")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    if path.suffix == ".db3" and (path.parent / "metadata.yaml").is_file():
        path = path.parent
    try:
        _check_bag(path)
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            known = {one.topic: one for one in reader.connections if one.msgtype == JOINT_STATE}
            if not known:
                there = ", ".join(sorted({one.topic for one in reader.connections})) or "none"
                raise InputError(f"{path}: holds no {JOINT_STATE}; its topics are {there}.")
            if topic is not None and topic not in known:
                raise InputError(f"{path}: has no joint states on '{topic}'; they are on {', '.join(known)}.")
            chosen = topic or max(known, key=lambda name: known[name].msgcount)
            links = [one for one in reader.connections if one.topic == chosen]
            rows = list(_list_states(reader, links))
    except (InputError, MemoryError):
        raise
    except Exception as error:  # readers raise many kinds of errors on a broken bag
        told = f"cannot be read as a ROS 2 bag ({describe(error)})"
        raise InputError(f"{path}: {told}; copy it again, whole.") from error
    if not rows:
        raise InputError(f"{path}: topic '{chosen}' holds no message; record it again.")
    frame = pd.DataFrame(rows)
    # Drivers that publish each joint separately send several messages with the same stamp.
    frame = frame.groupby("time", sort=True, as_index=False).first()
    note = f"{path.name}: {len(rows)} joint states of topic {chosen}."
    return frame, [note]


def _check_bag(path: Path) -> None:
    """Refuse bags that the reader could not finish: special or too large files, or YAML that expands."""
    described = path / "metadata.yaml"
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        check_plain(file, limits.TABLE_BYTES, "copy the bag again, or split it where it is large")
    about = load_plain_yaml(described.read_text(encoding="utf-8")) if described.is_file() else {}
    if str(about.get("rosbag2_bagfile_information", {}).get("compression_mode")).lower() == "file":
        raise InputError(f"{path}: its files are compressed whole; unpack them with 'ros2 bag convert'.")


def _list_states(reader: Any, links: list[Any]) -> Iterator[dict[str, float]]:
    """Yield one row for each message: ``time`` [s] from the first one, and each joint's signals."""
    first: int | None = None
    known: set[str] = set()
    for connection, received, raw in reader.messages(connections=links):
        message = reader.deserialize(raw, connection.msgtype)
        if len({*message.name}) < len(message.name):  # it is unknown which value is the joint's
            again = escape_text(max(message.name, key=message.name.count))[:30]
            raise InputError(f"{links[0].topic}: names '{again}' twice; give each joint a name of its own.")
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec or received
        first = stamp if first is None else first
        row = {"time": (stamp - first) * 1e-9}
        for field in ("position", "velocity", "effort"):
            values = getattr(message, field)
            row |= {f"{name}.{field}": float(one) for name, one in zip(message.name, values, strict=False)}
        known.update(row)
        if len(known) > limits.COLUMNS:
            raise InputError(f"{links[0].topic}: has more than {limits.COLUMNS} names; leave out some.")
        yield row
