"""The recordings of a chunk as one file, for a storage that carries files by name where no disk is shared."""

import re
import shutil
import tarfile
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import IO

from wearscope.files import DamagedFile, write_whole
from wearscope.simulation.traces import point_path

#: A recording as its member is called.
MEMBER = re.compile(r"point=\d+/recording\.parquet")


def pack_recordings(file: str | Path, points: Iterable[int]) -> None:
    """Write the recordings of some points, which lie in the file's folder, into one uncompressed tar.

    Its bytes depend on theirs alone.

    Parameters
    ----------
    file : path-like
        In the folder of the set, see `wearscope.simulation.traces.point_path`.
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


def unpack_recordings(files: Iterable[str | Path]) -> None:
    """Lay packed recordings where `point_path` looks for them.

    Parameters
    ----------
    files : iterable of path-like
        As `pack_recordings` wrote them.

    Raises
    ------
    DamagedFile
        Where a file is not there, cut, or holds anything else.
    """
    for file in map(Path, files):
        try:
            with tarfile.open(file, "r:") as tar:
                for member in tar:
                    if not (member.isreg() and MEMBER.fullmatch(member.name)):
                        raise tarfile.TarError(f"member {member.name!r}")
                    content = tar.extractfile(member)
                    assert content is not None  # it is a regular file
                    write_whole(file.parent / member.name, partial(_copy, content))
        except (tarfile.TarError, EOFError, FileNotFoundError) as error:
            raise DamagedFile(
                file, f"{file}: not the recordings of a chunk ({error}); delete it and simulate them again."
            ) from error


def _copy(content: IO[bytes], name: str) -> None:
    with open(name, "wb") as file:
        shutil.copyfileobj(content, file)
