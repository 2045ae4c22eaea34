"""The tar file of an archive: written so that equal content gives equal bytes, read in small pieces."""

import hashlib
import io
import tarfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import IO, Any

from wearscope import limits
from wearscope.archive.manifest import (
    CHECKSUM,
    MANIFEST,
    FileEntry,
    Manifest,
    parse_manifest,
    show,
)
from wearscope.errors import InputError, describe

_BLOCK = 1 << 20
#: Kinds of header that `tarfile` reads whole.
_LARGE = (
    tarfile.GNUTYPE_LONGNAME,
    tarfile.GNUTYPE_LONGLINK,
    tarfile.XHDTYPE,
    tarfile.XGLTYPE,
    tarfile.SOLARIS_XHDTYPE,
)


class _Header(tarfile.TarInfo):
    """A header; refused where its own content is large, such as a long name that `tarfile` reads whole."""

    def _proc_member(self, tar: tarfile.TarFile) -> Any:
        if self.type in _LARGE and self.size > limits.TAR_HEADER_BYTES:
            raise tarfile.ReadError(f"a header of more than {limits.TAR_HEADER_BYTES} bytes")
        return super()._proc_member(tar)  # type: ignore[misc]


def write_tar(path: str, members: Iterable[tuple[str, int, Callable[[], IO[bytes]]]]) -> None:
    """Write an uncompressed tar.

    Parameters
    ----------
    path : str
    members : iterable of (name, size, open)
        In this order; `open` gives the content.
    """
    with tarfile.open(path, "w", format=tarfile.PAX_FORMAT) as tar:
        for name, size, opened in members:
            member = tarfile.TarInfo(name)
            member.size, member.mode = size, 0o644
            with opened() as content:
                tar.addfile(member, content)


def walk_archive(path: str | Path) -> Manifest:
    """Check an archive from its first byte to its last.

    No more is read of a file than the manifest says, nothing is decompressed, no name leads elsewhere.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    InputError
        Where the file is no archive of a study, or the first thing that is missing, unknown or altered.
    """
    path = Path(path)
    try:
        if not path.is_file():
            reason = "is no plain file" if path.exists() else "no such file"
            raise InputError(f"{path}: {reason}; name an archive made by the target archive.")
        with tarfile.open(path, "r:", tarinfo=_Header) as tar:
            manifest = _read_manifest(tar, path)
            waiting = dict(manifest.files)
            while (member := tar.next()) is not None:
                name = show(member.name)
                if member.name not in waiting:
                    raise InputError(f"{path}: {name} is not in its manifest; get the file again.")
                _check_content(tar, member, waiting.pop(member.name), path)
            end = tar.offset
        _check_end(path, end)
    except (tarfile.TarError, EOFError, OSError, ValueError, OverflowError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        told = f"is no whole tar archive ({describe(error)})"
        raise InputError(f"{path}: {told}; get the file again.") from error
    if waiting:
        raise InputError(f"{path}: {show(min(waiting))} is missing; get the file again.")
    return manifest


def describe_checksum(manifest: bytes) -> bytes:
    """Content of ``MANIFEST.sha256``, as `sha256sum` writes it."""
    return f"{hashlib.sha256(manifest).hexdigest()}  {MANIFEST}\n".encode()


def extract_archive(path: str | Path, folder: Path) -> None:
    """Write the files of an archive that `walk_archive` found good into a folder, as new files.

    Raises
    ------
    OSError
        Where the disk refuses one.
    """
    with tarfile.open(path, "r:") as tar:
        tar.extraction_filter = getattr(tarfile, "data_filter", None)  # new in Python 3.11.4
        members = tar.getmembers()
        now = time.time()
        for member in members:
            member.mtime = now
        tar.extractall(folder, members)


def read_member(path: str | Path, name: str) -> bytes:
    """Content of one file of an archive that `walk_archive` found good."""
    with tarfile.open(path, "r:") as tar:
        file = tar.extractfile(name)
        assert file is not None
        return file.read()


def _read_manifest(tar: tarfile.TarFile, path: Path) -> Manifest:
    first = tar.next()
    if first is None or first.name != MANIFEST or not _is_plain(first):
        raise InputError(f"{path}: is no archive of a study; its first member is not {MANIFEST}.")
    if first.size > limits.MANIFEST_BYTES:
        raise InputError(
            f"{path}: {MANIFEST} is larger than {limits.MANIFEST_BYTES / 1e6:g} MB; get the file again."
        )
    content = _read_small(tar, first)
    manifest = parse_manifest(content, str(path))
    if manifest.format > 1:
        second = tar.next()
        good = second is not None and second.name == CHECKSUM and _is_plain(second) and second.size < 200
        wanted = _read_small(tar, second) if good and second is not None else b""
        if wanted != describe_checksum(content):
            raise InputError(
                f"{path}: {MANIFEST} is not what was packed (its checksum differs); get the file again."
            )
    return manifest


def _check_content(tar: tarfile.TarFile, member: tarfile.TarInfo, entry: FileEntry, path: Path) -> None:
    name = show(member.name)
    if not _is_plain(member):
        raise InputError(f"{path}: {name} is no plain file; get the file again.")
    if member.size != entry.bytes:
        raise InputError(
            f"{path}: {name} is not what was packed (its size is {member.size}, not {entry.bytes}); get the "
            "file again."
        )
    file = tar.extractfile(member)
    assert file is not None
    digest = hashlib.sha256()
    while block := file.read(_BLOCK):
        digest.update(block)
    if digest.hexdigest() != entry.sha256:
        raise InputError(f"{path}: {name} is not what was packed (its checksum differs); get the file again.")


def _read_small(tar: tarfile.TarFile, member: tarfile.TarInfo) -> bytes:
    file = tar.extractfile(member)
    assert file is not None
    return file.read()


def _is_plain(member: tarfile.TarInfo) -> bool:
    return member.isreg() and not member.issparse()


def _check_end(path: Path, end: int) -> None:
    """Only zeros follow the last member."""
    with open(path, "rb") as file:
        file.seek(end)
        while block := file.read(_BLOCK):
            if block.strip(b"\0"):
                raise InputError(f"{path}: something follows its end; get the file again.")


def as_content(content: bytes) -> Callable[[], IO[bytes]]:
    """Bytes as `write_tar` takes the content of a member."""
    return lambda: io.BytesIO(content)
