"""``MANIFEST.json`` of an archive: what it holds and was made with, believed only after it is checked."""

import re
from collections.abc import Iterable
from pathlib import PurePosixPath
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from wearscope import limits
from wearscope.errors import InputError, describe, explain_breach
from wearscope.storage.files import load_json

MANIFEST, CHECKSUM = "MANIFEST.json", "MANIFEST.sha256"
CONFIG = "config.yaml"
#: Format 1 is that of release 0.1.0: without the configuration and the manifest's own checksum.
FORMAT = 2
#: Files that packing makes; no file of a study has these names. Only release 0.2.0 made the last of them.
MADE = (MANIFEST, CHECKSUM, CONFIG, "ro-crate-metadata.json")

Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Part(BaseModel):
    """A part of the manifest; a key it does not know is an error."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class FileEntry(Part):
    """A file of the archive."""

    sha256: Digest
    bytes: Annotated[int, Field(ge=0, le=limits.ARCHIVE_BYTES)]


class CodeVersion(Part):
    """With which code the study was made."""

    wearscope: str
    commit: str | None
    changed: bool
    sha256: Digest
    files: dict[str, Digest]
    date: str | None = None
    """Of the commit."""


class Manifest(Part):
    """Content of ``MANIFEST.json``."""

    format: Literal[1, 2]
    study: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")]
    config: dict[str, Any]
    python: str
    packages: dict[str, str]
    code: CodeVersion
    inputs: dict[str, Digest] = {}
    """Digest by path of the user's own files: robots, test-cycles, detectors."""
    files: dict[str, FileEntry]


def parse_manifest(content: bytes, where: str) -> Manifest:
    """Read and check a manifest.

    Parameters
    ----------
    content : bytes
    where : str
        What messages call the archive.

    Raises
    ------
    InputError
        One sentence for the first thing that is wrong.
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
    """Refuse names of files that do not stay in their folder, or that a file system may not hold.

    Raises
    ------
    InputError
        Naming the first.
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
    """Name from an archive, without what a terminal would act on, cut where it is long."""
    return ascii(name[:80])[1:-1]


def _refuse_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    fields = dict(pairs)
    if len(fields) != len(pairs):
        raise ValueError("a key is there twice")
    return fields
