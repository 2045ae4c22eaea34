"""A finished study in one file: packed, unpacked, restored; the form is in `wearscope.archive`.

A restored configuration has no lines that would let code run, unless the user allows them.
"""

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import IO, Any

import yaml

from wearscope import limits
from wearscope.archive.members import (
    CHECKSUM,
    CONFIG,
    FORMAT,
    MANIFEST,
    FileEntry,
    Manifest,
    as_content,
    check_names,
    describe_checksum,
    extract_archive,
    parse_manifest,
    walk_archive,
    write_tar,
)
from wearscope.config import TAKEN, drop_retired
from wearscope.errors import InputError
from wearscope.storage.checksums import record_checksums
from wearscope.storage.files import (
    check_plain,
    digest_file,
    explain_unwritten,
    write_new,
    write_text,
    write_whole,
)
from wearscope.storage.plain_yaml import read_mapping
from wearscope.storage.provenance import describe_provenance


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
        The archive to write, whole or not at all.
    folder : path-like
        The study's results; members are named from here.
    files : iterable of path-like
        Files in `folder` to pack.
    config : mapping
        The validated configuration.
    sources : iterable of path-like
        Source files, paths from the repository; their digests are the code's version.
    report : callable, optional
        Called with a line about how far it is.
    inputs : iterable of path-like
        The user's own files: robots, test-cycles, detectors. They are not packed, their digests are kept.

    Returns
    -------
    Manifest

    Raises
    ------
    InputError
        Where a file is missing, a name cannot be packed, or the disk is full.
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

    def members() -> Iterator[tuple[str, int, Callable[[], IO[bytes]]]]:
        for name, content in ((MANIFEST, text), (CHECKSUM, checksum), (CONFIG, settings)):
            yield name, len(content), as_content(content)
        for done, name in enumerate(names, start=1):
            yield name, entries[name].bytes, partial(_open, folder / name)
            if report is not None and (done % 500 == 0 or done == len(names)):
                report(f"{done}/{len(names)} files packed")

    write_whole(path, lambda temporary: write_tar(temporary, members()))
    return manifest


def unpack_archive(
    path: str | Path, folder: str | Path, prepare: Callable[[Path], Any] = lambda _: None
) -> Manifest:
    """Unpack an archive, every byte checked, into a new or empty folder, whole or not at all.

    What was unpacked is given to `prepare` before it appears under its name.

    Returns
    -------
    Manifest
        Also written to the folder.

    Raises
    ------
    InputError
        As `walk_archive`; or where the folder holds something, or the disk refuses it.
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
    """Put a study's results back, so that the workflow goes on from them.

    Parameters
    ----------
    path : path-like
        The archive.
    root : path-like
        A clone of the repository.
    allow_code : bool
        Whether lines of its configuration that name code stay; otherwise they are marked as refused.

    Returns
    -------
    manifest : Manifest
    folder : Path
        ``results/<study>`` in `root`, with the configuration as ``config.yaml``.
    refused : list of str
        Lines of the configuration that name code and were refused.
    changed : list of str
        Files of code and the user's own inputs that are missing in `root` or not as they were.

    Raises
    ------
    InputError
        As `unpack_archive`.
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
    """Whether a file has a digest; an archive may name any file of the machine, also a pipe or a device."""
    try:
        check_plain(path, limits.TEXT_BYTES, "")
        # Files that the kernel generates (in /proc) state no size, and reading them may not end.
        return (digest_file(path) if path.stat().st_size else hashlib.sha256().hexdigest()) == digest
    except (InputError, OSError):
        return False


def _prepare(place: Path, manifest: Manifest, allow_code: bool) -> list[str]:
    """Give unpacked results checksums and a configuration without code, as if the workflow had made them.

    Returns
    -------
    list of str
        Lines of the configuration that were refused.
    """
    stated = None
    if CONFIG in manifest.files:
        stated = read_mapping((place / CONFIG).read_bytes(), CONFIG, "get the file again")
    settings = drop_retired(manifest.config if stated is None else stated)
    kept, refused = (settings, []) if allow_code else refuse_code(settings)
    if kept != stated:
        write_text(place / CONFIG, yaml.safe_dump(kept, sort_keys=False, allow_unicode=True))
    # Logs and timings are no job's output: later runs overwrite them.
    left = ("logs/", "benchmarks/")
    outputs = [name for name in manifest.files if not name.startswith(left)]
    record_checksums(place, [place / name for name in outputs], write=write_new)
    return refused


def _open(path: Path) -> IO[bytes]:
    return open(path, "rb")


def _describe(content: bytes) -> FileEntry:
    return FileEntry(sha256=hashlib.sha256(content).hexdigest(), bytes=len(content))


#: Put before the path of code, so that the configuration is refused until the user has written it again.
REFUSED = "refused, read it first: "


def refuse_code(settings: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """A configuration whose paths of code are marked as refused, and which allows none.

    Snakemake itself would run Python in a configuration that asks for its template engine by a key with two
    underscores; such keys are taken out.

    Returns
    -------
    dict
    list of str
        What was refused, as ``place: value``.
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
