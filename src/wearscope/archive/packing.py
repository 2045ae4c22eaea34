"""Packs a finished study into a tar file, and verifies, unpacks and restores such files.

The format is described in `wearscope.archive.__main__`. Files are read in small blocks. ``MANIFEST.json``
lists the content and the versions that made it; it is used only after it has been checked. A restored
configuration cannot run code unless the user allows it.
"""

import hashlib
import io
import json
import os
import re
import shutil
import tarfile
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO, Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from wearscope import limits
from wearscope.config import TAKEN, drop_retired
from wearscope.errors import InputError, describe, explain_breach
from wearscope.storage.files import (
    check_plain,
    digest_file,
    explain_unwritten,
    load_json,
    record_checksums,
    write_new,
    write_text,
    write_whole,
)
from wearscope.storage.plain_yaml import read_mapping
from wearscope.storage.provenance import describe_provenance

MANIFEST, CHECKSUM = "MANIFEST.json", "MANIFEST.sha256"
CONFIG = "config.yaml"
#: Format that is written. Format 1, of release 0.1.0, lacks the configuration and the manifest's checksum.
FORMAT = 2
#: Files that packing adds; no file of a study may have these names. Only release 0.2.0 added the last one.
MADE = (MANIFEST, CHECKSUM, CONFIG, "ro-crate-metadata.json")

Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Part(BaseModel):
    """A part of the manifest; an unknown key in it is an error."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class FileEntry(Part):
    """Size [bytes] and SHA-256 of a file in the archive."""

    sha256: Digest
    bytes: Annotated[int, Field(ge=0, le=limits.ARCHIVE_BYTES)]


class CodeVersion(Part):
    """Version of the code that made the study, see `describe_provenance`."""

    wearscope: str
    commit: str | None
    changed: bool
    sha256: Digest
    files: dict[str, Digest]
    date: str | None = None
    """Date of the commit."""


class Manifest(Part):
    """Content of ``MANIFEST.json``."""

    format: Literal[1, 2]
    study: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")]
    config: dict[str, Any]
    python: str
    packages: dict[str, str]
    code: CodeVersion
    inputs: dict[str, Digest] = {}
    """SHA-256 of the user's own robots, test-cycles and detectors, by path; the files are not packed."""
    files: dict[str, FileEntry]


def parse_manifest(content: bytes, where: str) -> Manifest:
    """Read and check a manifest.

    Parameters
    ----------
    content : bytes
    where : str
        Name of the archive in messages.

    Raises
    ------
    InputError
        If the manifest is not valid; the message names the first fault.
    """
    try:
        fields = load_json(content, object_pairs_hook=_refuse_doubles)
    except (ValueError, RecursionError) as error:
        told = f"{MANIFEST} is not readable JSON ({describe(error)})"
        raise InputError(f"{where}: {told}; get the file again.") from None
    if not isinstance(fields, dict):
        raise InputError(f"{where}: {MANIFEST} holds no mapping; get the file again.")
    if type(fields.get("format")) is not int or fields["format"] not in (1, FORMAT):
        given = repr(fields.get("format"))[:40]
        raise InputError(
            f"{where}: has format {given}, this version reads 1 to {FORMAT}; use the version of wearscope "
            "that made it, or get the file again."
        )
    try:
        manifest = Manifest.model_validate(fields)
    except RecursionError:
        raise InputError(f"{where}: {MANIFEST}: is nested too deeply; get the file again.") from None
    except ValidationError as error:
        raise InputError(f"{where}: {MANIFEST}: {explain_breach(error)}; get the file again.") from None
    if manifest.format == 1 and any(name in manifest.files for name in MADE):
        raise InputError(f"{where}: {MANIFEST} lists a name that format 1 has not; get the file again.")
    check_names(manifest.files, where)
    if sum(entry.bytes for entry in manifest.files.values()) > limits.ARCHIVE_BYTES:
        raise InputError(
            f"{where}: would take more than {limits.ARCHIVE_BYTES >> 30} GiB; get the file again."
        )
    return manifest


def check_names(names: Iterable[str], where: str) -> None:
    """Refuse paths that lead out of the archive's folder, or that some file systems cannot store.

    Raises
    ------
    InputError
        If a path is refused; the message names the first one.
    """
    names = set(names)
    folders = {parent.as_posix() for name in names for parent in PurePosixPath(name).parents}
    for name in sorted(names):
        parts = name.split("/")
        reason = None
        if name.startswith("/") or ".." in parts:
            reason = "leads out of the archive"
        elif "" in parts or "." in parts:
            reason = "is no plain path"
        elif re.search(r"[\x00-\x1f\x7f-\x9f\\\ud800-\udfff]", name):
            reason = "holds a control character or a backslash"
        elif any(part[0] in ".-" for part in parts):
            reason = "is hidden or starts like an option"
        elif len(name.encode()) > limits.PATH or any(len(part.encode()) > 200 for part in parts):
            reason = "is too long"
        elif name in folders:
            reason = "is both a file and a folder"
        elif name in (MANIFEST, CHECKSUM):
            reason = "is taken by the archive itself"
        if reason:
            raise InputError(f"{where}: the name {show(name)} {reason}; get the file again.")


def show(name: str) -> str:
    """Return a name from an archive for printing: at most 80 characters, control characters escaped."""
    return ascii(name[:80])[1:-1]


def _refuse_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Build a mapping from JSON's pairs; refuse a key that is given twice."""
    fields = dict(pairs)
    if len(fields) != len(pairs):
        raise ValueError("a key is there twice")
    return fields


_BLOCK = 1 << 20
#: Types of tar headers whose content `tarfile` reads into memory at once.
_LARGE = (
    tarfile.GNUTYPE_LONGNAME,
    tarfile.GNUTYPE_LONGLINK,
    tarfile.XHDTYPE,
    tarfile.XGLTYPE,
    tarfile.SOLARIS_XHDTYPE,
)


class _Header(tarfile.TarInfo):
    """A tar header; refused if it is huge, such as an endless file name, since `tarfile` reads it at once."""

    def _proc_member(self, tar: tarfile.TarFile) -> Any:
        if self.type in _LARGE and self.size > limits.TAR_HEADER_BYTES:
            raise tarfile.ReadError(f"a header of more than {limits.TAR_HEADER_BYTES} bytes")
        return super()._proc_member(tar)  # type: ignore[misc]


def write_tar(path: str, members: Iterable[tuple[str, int, Callable[[], IO[Any]]]]) -> None:
    """Write an uncompressed tar file; dates and owners are zero, so that equal content gives equal bytes.

    Parameters
    ----------
    path : str
    members : iterable of (name, size, open)
        Members in the order of the file; calling `open` returns a file object with the content.
    """
    with tarfile.open(path, "w", format=tarfile.PAX_FORMAT) as tar:
        for name, size, opened in members:
            member = tarfile.TarInfo(name)
            member.size, member.mode = size, 0o644
            with opened() as content:
                tar.addfile(member, content)


def walk_archive(path: str | Path) -> Manifest:
    """Verify an archive from its first byte to its last and return its manifest.

    This is safe for a file from an unknown source: no member is read beyond the size in the manifest,
    nothing is decompressed, and a path that leads out of the archive is refused.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    InputError
        If the file is no archive of a study, or a member is missing, unknown or changed.
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
    """Return the content of ``MANIFEST.sha256`` for a manifest, in the format of `sha256sum`."""
    return f"{hashlib.sha256(manifest).hexdigest()}  {MANIFEST}\n".encode()


def extract_archive(path: str | Path, folder: Path) -> None:
    """Write the files of a verified archive (see `walk_archive`) into a folder, dated now.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    with tarfile.open(path, "r:") as tar:
        tar.extraction_filter = getattr(tarfile, "data_filter", None)  # new in Python 3.11.4
        members = tar.getmembers()
        now = time.time()
        for member in members:
            member.mtime = now
        tar.extractall(folder, members)


def read_member(path: str | Path, name: str) -> bytes:
    """Return the content of one file of a verified archive (see `walk_archive`)."""
    with tarfile.open(path, "r:") as tar:
        return bytes(_open_member(tar, name).read())


def _read_manifest(tar: tarfile.TarFile, path: Path) -> Manifest:
    """Read the manifest at the beginning of an archive; check it, and its checksum from format 2 on."""
    first = tar.next()
    if first is None or first.name != MANIFEST or not _is_plain(first):
        raise InputError(f"{path}: is no archive of a study; its first member is not {MANIFEST}.")
    if first.size > limits.MANIFEST_BYTES:
        raise InputError(
            f"{path}: {MANIFEST} is larger than {limits.MANIFEST_BYTES / 1e6:g} MB; get the file again."
        )
    content = _open_member(tar, first).read()
    manifest = parse_manifest(content, str(path))
    if manifest.format > 1:
        second = tar.next()
        good = second is not None and second.name == CHECKSUM and _is_plain(second) and second.size < 200
        wanted = _open_member(tar, second).read() if good and second is not None else b""
        if wanted != describe_checksum(content):
            raise InputError(
                f"{path}: {MANIFEST} is not what was packed (its checksum differs); get the file again."
            )
    return manifest


def _check_content(tar: tarfile.TarFile, member: tarfile.TarInfo, entry: FileEntry, path: Path) -> None:
    """Refuse a member that is no regular file or whose size or SHA-256 differs from the manifest's."""
    name = show(member.name)
    if not _is_plain(member):
        raise InputError(f"{path}: {name} is no plain file; get the file again.")
    if member.size != entry.bytes:
        raise InputError(
            f"{path}: {name} is not what was packed (its size is {member.size}, not {entry.bytes}); get the "
            "file again."
        )
    digest = hashlib.file_digest(_open_member(tar, member), "sha256")
    if digest.hexdigest() != entry.sha256:
        raise InputError(f"{path}: {name} is not what was packed (its checksum differs); get the file again.")


def _open_member(tar: tarfile.TarFile, member: tarfile.TarInfo | str) -> Any:
    """Return a file object with the content of a regular file in an archive."""
    file = tar.extractfile(member)
    assert file is not None
    return file


def _is_plain(member: tarfile.TarInfo) -> bool:
    """Return whether a member is a regular file; a sparse one may claim a huge size."""
    return member.isreg() and not member.issparse()


def _check_end(path: Path, end: int) -> None:
    """Refuse an archive in which anything but zeros follows the last member, at byte `end`."""
    with open(path, "rb") as file:
        file.seek(end)
        while block := file.read(_BLOCK):
            if block.strip(b"\0"):
                raise InputError(f"{path}: something follows its end; get the file again.")


def pack_study(
    path: str | Path,
    folder: str | Path,
    files: Iterable[str | Path],
    config: Mapping[str, Any],
    sources: Iterable[str | Path],
    report: Callable[[str], None] | None = None,
    inputs: Iterable[str | Path] = (),
) -> Manifest:
    """Pack a finished study.

    Parameters
    ----------
    path : path-like
        The archive to write, atomically.
    folder : path-like
        The study's results; names in the archive are relative to it.
    files : iterable of path-like
        Files in `folder` to pack.
    config : mapping
        The validated configuration.
    sources : iterable of path-like
        Source files, relative to the repository; their SHA-256 identify the version of the code.
    report : callable, optional
        Called with a line about the progress.
    inputs : iterable of path-like
        The user's own robots, test-cycles and detectors. Only their SHA-256 are recorded.

    Returns
    -------
    Manifest

    Raises
    ------
    InputError
        If a file is missing, a name is refused (see `check_names`), or the archive cannot be written.
    """
    folder = Path(folder)
    names = sorted(Path(file).relative_to(folder).as_posix() for file in files)
    check_names(names, str(path))
    made = describe_provenance(sources)
    own = {Path(file).as_posix(): digest_file(Path(file)) for file in inputs}
    settings = yaml.safe_dump(dict(config), sort_keys=False, allow_unicode=True, width=100).encode()
    entries = {CONFIG: _describe(settings)}
    for name in names:
        if not (folder / name).is_file():
            raise InputError(f"{folder / name}: no such file; run the study to its end before packing it.")
        entries[name] = FileEntry(sha256=digest_file(folder / name), bytes=(folder / name).stat().st_size)
    fields = {
        "format": FORMAT,
        "study": config.get("study"),
        "config": dict(config),
        **made,
        "inputs": own,
        "files": {name: entry.model_dump() for name, entry in entries.items()},
    }
    text = json.dumps(fields, indent=1).encode()
    manifest = parse_manifest(text, str(path))
    checksum = describe_checksum(text)

    def members() -> Iterator[tuple[str, int, Callable[[], IO[Any]]]]:
        for name, content in ((MANIFEST, text), (CHECKSUM, checksum), (CONFIG, settings)):
            yield name, len(content), partial(io.BytesIO, content)
        for done, name in enumerate(names, start=1):
            yield name, entries[name].bytes, partial((folder / name).open, "rb")
            if report is not None and (done % 500 == 0 or done == len(names)):
                report(f"{done}/{len(names)} files packed")

    write_whole(path, lambda temporary: write_tar(temporary, members()))
    return manifest


def unpack_archive(
    path: str | Path, folder: str | Path, prepare: Callable[[Path], Any] = lambda _: None
) -> Manifest:
    """Verify an archive and unpack it into a new or empty folder, completely or not at all.

    `prepare` is called with the folder of unpacked files before that gets its final name.

    Returns
    -------
    Manifest
        The manifest, which is unpacked too.

    Raises
    ------
    InputError
        If the archive is refused (see `walk_archive`), the folder is not empty, or it cannot be written.
    """
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: is not empty; name a folder that is not there yet.")
    manifest = walk_archive(path)
    staging, new = "", not folder.parent.exists()
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        staging = tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent)
        place = Path(staging)
        extract_archive(path, place)
        prepare(place)
        os.chmod(place, 0o755)
        if folder.exists():
            folder.rmdir()
        os.replace(place, folder)
    except OSError as error:
        raise explain_unwritten(folder, error) from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        if new:
            with suppress(OSError):  # the folder holds what was unpacked
                folder.parent.rmdir()
    return manifest


def restore_archive(
    path: str | Path, root: str | Path = ".", allow_code: bool = False
) -> tuple[Manifest, Path, list[str], list[str]]:
    """Unpack a study into the folder of results, so that the workflow can continue from it.

    Parameters
    ----------
    path : path-like
        The archive.
    root : path-like
        A clone of the repository.
    allow_code : bool
        Whether the configuration keeps its settings that name code; otherwise see `refuse_code`.

    Returns
    -------
    manifest : Manifest
    folder : Path
        ``results/<study>`` in `root`, with the configuration as ``config.yaml``.
    refused : list of str
        Settings that name code and were refused.
    changed : list of str
        Source files and inputs of the user that are missing in `root` or differ from the packed study's.

    Raises
    ------
    InputError
        If the archive or the folder is refused (see `unpack_archive`).
    """
    root = Path(root)
    manifest = walk_archive(path)
    folder = root / "results" / manifest.study
    if manifest.study in TAKEN:
        raise InputError(f"{path}: {folder} holds something else than a study; unpack it into a new folder.")
    refused: list[str] = []
    unpack_archive(path, folder, lambda place: refused.extend(_prepare(place, manifest, allow_code)))
    changed = [
        name
        for name, digest in sorted({**manifest.code.files, **manifest.inputs}.items())
        if not _is_as(root / name, digest)
    ]
    return manifest, folder, refused, changed


def _is_as(path: Path, digest: str) -> bool:
    """Return whether a file has a given SHA-256.

    An archive may name any path of this machine, so a pipe or device must not be read.
    """
    try:
        check_plain(path, limits.TEXT_BYTES, "")
        # The kernel's files in /proc have size 0, but reading them may never end: so size 0 is not read.
        return (digest_file(path) if path.stat().st_size else hashlib.sha256().hexdigest()) == digest
    except (InputError, OSError):
        return False


def _prepare(place: Path, manifest: Manifest, allow_code: bool) -> list[str]:
    """Add what the workflow needs to unpacked results: checksums, and a configuration without code.

    Returns
    -------
    list of str
        Settings that were refused, see `refuse_code`.
    """
    stated = None
    if CONFIG in manifest.files:
        stated = read_mapping((place / CONFIG).read_bytes(), CONFIG, "get the file again")
    settings = drop_retired(manifest.config if stated is None else stated)
    kept, refused = (settings, []) if allow_code else refuse_code(settings)
    if kept != stated:
        write_text(place / CONFIG, yaml.safe_dump(kept, sort_keys=False, allow_unicode=True))
    # Logs and timings get no checksum, because later runs overwrite them.
    left = ("logs/", "benchmarks/")
    outputs = [name for name in manifest.files if not name.startswith(left)]
    record_checksums(place, [place / name for name in outputs], write=write_new)
    return refused


def _describe(content: bytes) -> FileEntry:
    """Return the manifest's entry for a file's content."""
    return FileEntry(sha256=hashlib.sha256(content).hexdigest(), bytes=len(content))


#: Prefix of a refused path of code. The configuration is invalid until the user has removed the prefix.
REFUSED = "refused, read it first: "


def refuse_code(settings: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Return a configuration that cannot run code: paths of code are marked, and ``allow_code`` is false.

    Keys that begin with two underscores are removed: by such a key Snakemake can be told to expand the
    configuration with a template engine, which runs Python.

    Returns
    -------
    dict
        The configuration without code.
    list of str
        Refused settings, as ``place: value``.
    """
    refused: list[str] = []

    def walk(value: Any, place: str) -> Any:
        if isinstance(value, Mapping):
            kept = {}
            for key, inner in value.items():
                where = f"{place}.{key}" if place else str(key)
                if str(key).startswith("__"):
                    refused.append(where)
                elif key == "allow_code" and inner not in (False, None, []):
                    refused.append(f"{where}: {inner}")
                    kept[key] = False
                else:
                    kept[key] = walk(inner, where)
            return kept
        if isinstance(value, list):
            return [walk(one, place) for one in value]
        if isinstance(value, str) and value.endswith(".py"):
            refused.append(f"{place}: {value}")
            return f"{REFUSED}{value.removesuffix('.py')}"
        return value

    return walk(settings, ""), refused
