"""Where recordings lie: a folder a set, a partition a point; a chunk as one file, which a storage carries."""

import re
import shutil
import tarfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from wearscope.robots.model import RobotModel
from wearscope.simulation.recording import Recording, read_recording
from wearscope.storage.files import DamagedFile, write_whole

#: A recording as its member is called.
MEMBER = re.compile(r"point=(\d+)/recording\.parquet")


def point_path(folder: str | Path, set_name: str, point: int) -> Path:
    """File of a design point's recording: one partition a point."""
    return Path(folder) / set_name / f"point={point}" / "recording.parquet"


def pack_recordings(file: str | Path, points: Iterable[int]) -> None:
    """Write the recordings of some points, which lie in the file's folder, into one uncompressed tar.

    Its bytes depend on theirs alone.

    Parameters
    ----------
    file : path-like
        In the folder of the set, see `point_path`.
    points : iterable of int
        Those that have a recording.

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
    """Remove the recordings of some points, which lie in the folder of a set and were packed."""
    for point in points:
        shutil.rmtree(point_path(Path(folder).parent, Path(folder).name, point).parent, ignore_errors=True)


class PackedRecordings:
    """Recordings that are read where they were packed.

    Parameters
    ----------
    files : iterable of path-like
        As `pack_recordings` wrote them, each in the folder of its set.

    Raises
    ------
    DamagedFile
        Where a file is not there, cut, or holds anything else.
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
        """Whether there is a file of a set."""
        return any(file.parent.name == set_name for file in self._files)

    def read(self, set_name: str, point: int) -> tuple[Path, bytes]:
        """File that a recording is packed in, and its content.

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
    """Recordings of some points of a set, one at a time.

    Parameters
    ----------
    folder : path-like
        Traces of this robot and test-cycle.
    set_name : str
    points : sequence of int
    model : RobotModel
    fingerprints : mapping of (set, point) to str, optional
        What the recordings must have been made from, see `wearscope.simulation.chunk.fingerprint_point`.
    packed : PackedRecordings, optional
        Where they are, if not a file a point in the folder.

    Raises
    ------
    DamagedFile
        Where a recording is missing, damaged or another one.
    """
    for point in map(int, points):
        wanted = None if fingerprints is None else fingerprints[set_name, point]
        if packed is not None and packed.holds(set_name):
            path, content = packed.read(set_name, point)
            yield point, read_recording(path, model.joints, wanted, content)
        else:
            yield point, read_recording(point_path(folder, set_name, point), model.joints, wanted)
