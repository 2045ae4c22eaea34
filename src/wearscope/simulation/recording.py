"""Recordings of simulated runs, as a drive would record them: their Parquet files and folders.

Each set of a study has a folder, with one Parquet file for each point. The recordings of a chunk can also be
packed into one tar file, which is easier to keep in a remote storage.
"""

import re
import shutil
import tarfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from wearscope.errors import InputError
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Array
from wearscope.storage import tables
from wearscope.storage.files import DamagedFile, write_whole

COLUMNS = ("t", "joint", "q", "qd", "tau")


@dataclass(frozen=True, eq=False)
class Recording:
    """A recorded run.

    Attributes
    ----------
    t : ndarray (N,)
        Time [s], evenly spaced.
    q, qd : ndarray (N, n)
        Position and speed of the motors, as joint position [rad or m] and speed [rad/s or m/s].
    tau : ndarray (N, n)
        Motor torque at the joint [N m or N].
    """

    t: Array
    q: Array
    qd: Array
    tau: Array


def write_recording(
    path: str | Path,
    recording: Recording,
    joints: Sequence[str],
    position_units: Sequence[str] | None = None,
    torque_units: Sequence[str] | None = None,
    fingerprint: str | None = None,
) -> None:
    """Write a run in long form: `t`, `joint`, `q`, `qd`, `tau`, joint after joint.

    Speed and torque are stored in single precision, whose error is about a millionth of the sensors' noise.
    Position is stored in double precision, which keeps the encoder's steps. Equal recordings give equal
    bytes.

    Parameters
    ----------
    path : path-like
    recording : Recording
    joints : sequence of str (n,)
    position_units, torque_units : sequence of str (n,), optional
        Units by joint, rad and N m by default. Where joints differ, the column's unit lists each joint's.
    fingerprint : str, optional
        Digest of everything that the run depends on, kept in the file's metadata; see `read_fingerprint`.
    """
    count, n = recording.q.shape
    position_units = ["rad"] * n if position_units is None else list(position_units)
    torque_units = ["N m"] * n if torque_units is None else list(torque_units)
    speed_units = [f"{unit}/s" for unit in position_units]
    names = pa.DictionaryArray.from_arrays(
        tables.to_array(np.repeat(np.arange(n, dtype=np.int32), count)), tables.to_array(list(joints))
    )
    table = tables.to_arrow(
        {
            "t": np.tile(recording.t, n),
            "joint": names,
            "q": recording.q.T.ravel(),
            "qd": recording.qd.T.ravel().astype(np.float32),
            "tau": recording.tau.T.ravel().astype(np.float32),
        },
        {
            "t": "s",
            "q": join_units(joints, position_units),
            "qd": join_units(joints, speed_units),
            "tau": join_units(joints, torque_units),
        },
    )
    if fingerprint is not None:
        table = table.replace_schema_metadata({"fingerprint": fingerprint})
    tables.write_arrow(
        path,
        table,
        use_dictionary=["t", "joint"],
        column_encoding={column: "BYTE_STREAM_SPLIT" for column in ("q", "qd", "tau")},
        row_group_size=count * n,
    )


def read_fingerprint(path: str | Path) -> str | None:
    """Return the fingerprint of a recording; None where the file is missing, damaged or has none."""
    try:
        table = tables.read_arrow(path, list(COLUMNS))
    except tables.DamagedFile:
        return None
    return _fingerprint(table)


def _fingerprint(table: pa.Table) -> str | None:
    value = (table.schema.metadata or {}).get(b"fingerprint")
    return None if value is None else value.decode(errors="replace")


def join_units(joints: Sequence[str], units: Sequence[str]) -> str:
    """Return the unit of a column that holds all joints: one unit, or a list by joint where they differ."""
    if len(set(units)) == 1:
        return units[0]
    return ", ".join(f"{joint}: {unit}" for joint, unit in zip(joints, units, strict=True))


def read_recording(
    path: str | Path,
    joints: Sequence[str] | None = None,
    fingerprint: str | None = None,
    content: bytes | None = None,
) -> Recording:
    """Read a recording; the checksums of its Parquet pages are verified.

    Parameters
    ----------
    path : path-like
    joints : sequence of str, optional
        Order of the joints; that of the file by default.
    fingerprint : str, optional
        Fingerprint that the recording must have. Another one means another point, setting or code.
    content : bytes, optional
        Bytes of the recording, where `path` is a packed file that holds several.

    Raises
    ------
    DamagedFile
        Where the file is missing, damaged, or not the recording with the fingerprint.
    InputError
        Where it does not hold these joints.
    """
    table = tables.read_arrow(path if content is None else content, list(COLUMNS), str(path))
    if fingerprint is not None and _fingerprint(table) != fingerprint:
        raise tables.DamagedFile(
            path, f"{path}: is the recording of another point or setting; delete it and simulate it again."
        )
    if table.column("joint").type != pa.dictionary(pa.int32(), pa.string()):
        raise tables.DamagedFile(path, f"{path}: holds no names of joints; delete it and simulate it again.")
    column = table.column("joint").combine_chunks()
    if isinstance(column, pa.ChunkedArray):
        column = column.chunk(0)
    codes, names = column.indices.to_numpy(), column.dictionary.to_pylist()
    order = list(range(len(names)))
    if joints is not None:
        if sorted(joints) != sorted(names):
            raise InputError(
                f"{path}: holds the joints {', '.join(names)}, not {', '.join(joints)}; simulate it again."
            )
        order = [names.index(joint) for joint in joints]
    count = len(codes) // len(names)
    if not np.array_equal(codes, np.repeat(np.arange(len(names)), count)):
        raise InputError(f"{path}: its joints do not stand one after the other; simulate it again.")

    def shape(name: str) -> Array:
        values = table.column(name).to_numpy().reshape(len(names), count)
        return np.ascontiguousarray(values[order].T, dtype=float)

    return Recording(table.column("t").to_numpy()[:count].copy(), shape("q"), shape("qd"), shape("tau"))


#: Name of a recording within the file of its chunk.
MEMBER = re.compile(r"point=(\d+)/recording\.parquet")


def point_path(folder: str | Path, set_name: str, point: int) -> Path:
    """Return the file of a design point's recording: one folder for each point."""
    return Path(folder) / set_name / f"point={point}" / "recording.parquet"


def pack_recordings(file: str | Path, points: Iterable[int]) -> None:
    """Pack the recordings of some points into one uncompressed tar file, whose bytes depend on them alone.

    Parameters
    ----------
    file : path-like
        File to write, in the folder of the set that holds the recordings, see `point_path`.
    points : iterable of int
        Points that have a recording.

    Raises
    ------
    InputError
        Where the disk refuses the file.
    """
    folder = Path(file).parent
    paths = [point_path(folder.parent, folder.name, point) for point in sorted(points)]

    def write(name: str) -> None:
        with tarfile.open(name, "w", format=tarfile.PAX_FORMAT) as tar:
            for path in paths:
                member = tarfile.TarInfo(path.relative_to(folder).as_posix())
                member.size = path.stat().st_size
                with open(path, "rb") as content:
                    tar.addfile(member, content)

    write_whole(file, write)


def remove_recordings(folder: str | Path, points: Iterable[int]) -> None:
    """Remove the single recordings of some points from the folder of their set, after they were packed."""
    for point in points:
        shutil.rmtree(point_path(Path(folder).parent, Path(folder).name, point).parent, ignore_errors=True)


class PackedRecordings:
    """Recordings in tar files, which are read without unpacking the files.

    Parameters
    ----------
    files : iterable of path-like
        Files that `pack_recordings` wrote, each in the folder of its set.

    Raises
    ------
    DamagedFile
        Where a file is missing, truncated, or holds anything but recordings.
    """

    def __init__(self, files: Iterable[str | Path]) -> None:
        self._files = [Path(file) for file in files]
        self._places: dict[tuple[str, int], tuple[Path, int, int]] = {}
        for file in self._files:
            try:
                with tarfile.open(file, "r:") as tar:
                    for member in tar:
                        named = MEMBER.fullmatch(member.name)
                        if named is None or not member.isreg():
                            raise tarfile.TarError(f"member {member.name!r}")
                        place = file, member.offset_data, member.size
                        self._places[file.parent.name, int(named[1])] = place
            except (tarfile.TarError, EOFError, FileNotFoundError) as error:
                raise DamagedFile(
                    file,
                    f"{file}: not the recordings of a chunk ({error}); delete it and simulate them again.",
                ) from error

    def holds(self, set_name: str) -> bool:
        """Return whether any of the files belongs to a set."""
        return any(file.parent.name == set_name for file in self._files)

    def read(self, set_name: str, point: int) -> tuple[Path, bytes]:
        """Return the file that holds a recording, and the recording's bytes.

        Raises
        ------
        DamagedFile
            Where no file holds it.
        """
        if (set_name, point) not in self._places:
            own = [file for file in self._files if file.parent.name == set_name] or self._files
            raise DamagedFile(
                own[0], f"{own[0]}: no recording of {set_name} point {point}; simulate its chunk again."
            )
        file, start, size = self._places[set_name, point]
        with open(file, "rb") as content:
            content.seek(start)
            return file, content.read(size)


def read_points(
    folder: str | Path,
    set_name: str,
    points: Sequence[int],
    model: RobotModel,
    fingerprints: Mapping[tuple[str, int], str] | None = None,
    packed: PackedRecordings | None = None,
) -> Iterator[tuple[int, Recording]]:
    """Yield the recordings of some points of a set, one at a time.

    Parameters
    ----------
    folder : path-like
        Folder of the recordings of this robot and test-cycle.
    set_name : str
    points : sequence of int
    model : RobotModel
    fingerprints : mapping of (set, point) to str, optional
        Fingerprints that the recordings must have, see `wearscope.simulation.chunk.fingerprint_point`.
    packed : PackedRecordings, optional
        Packed files, which are used for every set that they hold; other sets are read point by point.

    Raises
    ------
    DamagedFile
        Where a recording is missing, damaged, or has another fingerprint.
    """
    for point in map(int, points):
        wanted = None if fingerprints is None else fingerprints[set_name, point]
        if packed is not None and packed.holds(set_name):
            path, content = packed.read(set_name, point)
            yield point, read_recording(path, model.joints, wanted, content)
        else:
            yield point, read_recording(point_path(folder, set_name, point), model.joints, wanted)
