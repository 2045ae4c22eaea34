"""A finished study in one file: packed, verified, unpacked, restored.

The file is an uncompressed tar (Parquet and PNG are compressed already). Its first member,
``MANIFEST.json``, holds the configuration, the versions of code and packages, and size and SHA-256 of every
file; the second, ``MANIFEST.sha256``, the manifest's own. ``config.yaml`` is the configuration. Equal content
gives equal bytes.

    python -m wearscope.archive verify FILE
    python -m wearscope.archive unpack FILE FOLDER
    python -m wearscope.archive restore FILE
"""

import argparse
import hashlib
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import IO, Any

import yaml

from wearscope import limits
from wearscope.archives.code import read_settings, refuse_code
from wearscope.archives.comparison import list_results
from wearscope.archives.manifest import (
    CHECKSUM,
    CONFIG,
    FORMAT,
    MANIFEST,
    FileEntry,
    Manifest,
    check_names,
    parse_manifest,
    show,
)
from wearscope.archives.members import as_content, describe_checksum, extract_archive, walk_archive, write_tar
from wearscope.config import TAKEN, drop_retired
from wearscope.errors import InputError
from wearscope.processes import end_process
from wearscope.storage.checksums import record_checksums
from wearscope.storage.files import (
    check_plain,
    digest_file,
    explain_unwritten,
    write_new,
    write_text,
    write_whole,
)
from wearscope.storage.provenance import describe_provenance

__all__ = ["list_results", "main", "pack_study", "restore_archive", "unpack_archive", "walk_archive"]


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
            with suppress(OSError):  # it holds what was unpacked
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
    """Whether a file that an archive names, which may be any of the machine's, has a digest."""
    try:
        check_plain(path, limits.TEXT_BYTES, "")
        # What the system makes up as it is read, such as its log, has no size, and may have no end.
        return (digest_file(path) if path.stat().st_size else hashlib.sha256().hexdigest()) == digest
    except (InputError, OSError):
        return False


def _prepare(place: Path, manifest: Manifest, allow_code: bool) -> list[str]:
    """Make unpacked results such as the workflow's own: with checksums, and a configuration without code.

    Returns
    -------
    list of str
        Lines of the configuration that were refused.
    """
    stated = read_settings(place / CONFIG) if CONFIG in manifest.files else None
    settings = drop_retired(manifest.config if stated is None else stated)
    kept, refused = (settings, []) if allow_code else refuse_code(settings)
    if kept != stated:
        write_text(place / CONFIG, yaml.safe_dump(kept, sort_keys=False, allow_unicode=True))
    # Logs and timings are no job's output: they are written over without a word.
    left = ("logs/", "benchmarks/")
    outputs = [name for name in manifest.files if not name.startswith(left)]
    record_checksums(place, [place / name for name in outputs], write=write_new)
    return refused


def _open(path: Path) -> IO[bytes]:
    return open(path, "rb")


def _describe(content: bytes) -> FileEntry:
    return FileEntry(sha256=hashlib.sha256(content).hexdigest(), bytes=len(content))


def main(arguments: list[str] | None = None) -> int:
    """Command line; 1 where the input is bad."""
    parser = argparse.ArgumentParser(prog="python -m wearscope.archive", description="Archives of studies.")
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("verify", help="check every checksum").add_argument("file")
    unpack = commands.add_parser("unpack", help="check and unpack into a new folder")
    unpack.add_argument("file")
    unpack.add_argument("folder")
    restore = commands.add_parser("restore", help="put the results back, to go on from them")
    restore.add_argument("file")
    restore.add_argument("root", nargs="?", default=".", help="a clone of the repository, by default here")
    restore.add_argument("--allow-code", action="store_true", help="keep what its configuration lets run")
    given = parser.parse_args(arguments)
    try:
        if given.command == "restore":
            restored = restore_archive(given.file, given.root, given.allow_code)
            _tell_restored(given.file, *restored)
            return 0
        if given.command == "unpack":
            manifest = unpack_archive(given.file, given.folder)
        else:
            manifest = walk_archive(given.file)
    except InputError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{given.file}: study {manifest.study}, {len(manifest.files)} files, every checksum holds")
    return 0


def _tell_restored(
    file: str, manifest: Manifest, folder: Path, refused: list[str], changed: list[str]
) -> None:
    print(f"{file}: {len(manifest.files)} files, every checksum holds, in {folder}")
    if refused:
        told = f"{folder / CONFIG}: names code, which is refused ({'; '.join(refused)})"
        print(InputError(f"{told}; read it, and restore with --allow-code to let it run."))
    if changed:
        names = ", ".join([*map(show, changed[:3]), *(["..."] if len(changed) > 3 else [])])
        print(
            f"{len(changed)} files of code or input are not as they were ({names}); for the same bytes use "
            f"wearscope {show(manifest.code.wearscope)}, commit {show(manifest.code.commit or 'unknown')}"
        )
    print(f"one stage again, e.g.: snakemake snr --cores 2 --configfile {folder / CONFIG} -R compute_snr")


if __name__ == "__main__":
    end_process(main())
