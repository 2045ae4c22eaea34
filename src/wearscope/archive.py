"""A finished study in one file: packed, verified, unpacked elsewhere, compared with another.

The file is an uncompressed tar (Parquet and PNG are compressed already) whose first member,
``MANIFEST.json``, holds the configuration, the versions of code and packages, and the SHA-256 of every other
member. Equal content gives equal bytes.

    python -m wearscope.archive verify FILE
    python -m wearscope.archive unpack FILE FOLDER
    python -m wearscope.archive compare A B
"""

import argparse
import hashlib
import io
import json
import sys
import tarfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import pandas as pd

from wearscope import tables
from wearscope.compare import compare_tables
from wearscope.errors import InputError
from wearscope.files import digest_file
from wearscope.provenance import describe_provenance

MANIFEST = "MANIFEST.json"
FORMAT = 1


def pack_study(
    path: str | Path,
    folder: str | Path,
    files: Iterable[str | Path],
    config: Mapping[str, Any],
    sources: Iterable[str | Path],
    report: Callable[[str], None] | None = None,
) -> dict[str, Any]:
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

    Returns
    -------
    dict
        The manifest.

    Raises
    ------
    InputError
        Where a file is missing or the disk is full.
    """
    folder = Path(folder)
    names = sorted(Path(file).relative_to(folder).as_posix() for file in files)
    members: dict[str, dict[str, Any]] = {}
    for name in names:
        if not (folder / name).is_file():
            raise InputError(f"{folder / name}: no such file; run the study to its end before packing it.")
        members[name] = {"sha256": digest_file(folder / name), "bytes": (folder / name).stat().st_size}
    manifest = {
        "format": FORMAT,
        "study": config.get("study"),
        "config": dict(config),
        **describe_provenance(sources),
        "files": members,
    }

    def write(temporary: str) -> None:
        with tarfile.open(temporary, "w", format=tarfile.PAX_FORMAT) as tar:
            text = json.dumps(manifest, indent=1, sort_keys=True).encode()
            tar.addfile(_member(MANIFEST, len(text)), io.BytesIO(text))
            for done, name in enumerate(names, start=1):
                with open(folder / name, "rb") as file:
                    tar.addfile(_member(name, members[name]["bytes"]), file)
                if report is not None and (done % 500 == 0 or done == len(names)):
                    report(f"{done}/{len(names)} files packed")

    tables.write_whole(path, write)
    return manifest


def verify_archive(path: str | Path) -> dict[str, Any]:
    """Check every member of an archive against the manifest.

    Returns
    -------
    dict
        The manifest.

    Raises
    ------
    InputError
        Where the file is no archive of a study, or the first member that is missing, unknown or altered.
    """
    return _walk(path, lambda name, content: None)


def unpack_archive(path: str | Path, folder: str | Path) -> dict[str, Any]:
    """Unpack an archive, checking every member, into a folder that is not there yet or empty.

    Returns
    -------
    dict
        The manifest, also written to the folder.

    Raises
    ------
    InputError
        As `verify_archive`; or where the folder holds something.
    """
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: is not empty; name a folder that is not there yet.")
    verify_archive(path)

    def write(name: str, content: bytes) -> None:
        tables.write_whole(folder / name, lambda temporary: Path(temporary).write_bytes(content))

    manifest = _walk(path, write)
    tables.write_text(folder / MANIFEST, json.dumps(manifest, indent=1, sort_keys=True))
    return manifest


def compare_archives(a: str | Path, b: str | Path) -> pd.DataFrame:
    """Compare two studies, table by table; each may be an archive or a folder of results.

    Returns
    -------
    DataFrame
        One row a setting, package, code version or file that differs, and one a table that is the same:
        ``item``, ``what`` (``setting``, ``version``, ``table``, ``file``), ``outcome`` (``same bytes``,
        ``same values``, ``differs``, ``only in a``, ``only in b``), ``detail``. Logs and timings are left
        out.
    """
    left, right = _Content(a), _Content(b)
    rows = []
    for what, key in (("setting", "config"), ("version", "packages"), ("version", "code")):
        rows += _compare_mappings(left.manifest.get(key, {}), right.manifest.get(key, {}), what, "")
    for name in sorted(set(left.digests) | set(right.digests)):
        if name.startswith(("logs/", "benchmarks/")):
            continue
        what = "table" if name.endswith(".parquet") else "file"
        detail = ""
        if name not in right.digests or name not in left.digests:
            outcome = "only in a" if name in left.digests else "only in b"
        elif left.digests[name] == right.digests[name]:
            if what == "file":
                continue
            outcome = "same bytes"
        elif what == "file":
            outcome = "differs"
        else:
            detail = compare_tables(left.table(name), right.table(name))
            outcome = "differs" if detail else "same values"
        rows.append({"item": name, "what": what, "outcome": outcome, "detail": detail})
    return pd.DataFrame(rows, columns=["item", "what", "outcome", "detail"])


class _Content:
    """An archive or a folder of results, read one table at a time."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.manifest: dict[str, Any] = {}
        if self.path.is_dir():
            files = [file for file in sorted(self.path.rglob("*")) if file.is_file()]
            self.digests = {file.relative_to(self.path).as_posix(): digest_file(file) for file in files}
            self.digests.pop(MANIFEST, None)
            if (self.path / MANIFEST).is_file():
                self.manifest = json.loads((self.path / MANIFEST).read_text(encoding="utf-8"))
        else:
            self.manifest = verify_archive(self.path)
            self.digests = {name: one["sha256"] for name, one in self.manifest["files"].items()}

    def table(self, name: str) -> pd.DataFrame:
        if self.path.is_dir():
            return tables.read_table(self.path / name)
        with tarfile.open(self.path) as tar:
            file = tar.extractfile(name)
            assert file is not None
            return pd.read_parquet(io.BytesIO(file.read()))


def _compare_mappings(a: Mapping[str, Any], b: Mapping[str, Any], what: str, prefix: str) -> list[dict]:
    rows: list[dict] = []
    for key in sorted(set(a) | set(b)):
        one, other = a.get(key), b.get(key)
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            rows += _compare_mappings(one, other, what, f"{prefix}{key}.")
        elif one != other:
            detail = f"{one} against {other}"
            rows.append({"item": f"{prefix}{key}", "what": what, "outcome": "differs", "detail": detail})
    return rows


def _walk(path: str | Path, visit: Callable[[str, bytes], None]) -> dict[str, Any]:
    """Check each member of an archive and hand it to `visit`."""
    try:
        with tarfile.open(path) as tar:
            first = tar.next()
            if first is None or first.name != MANIFEST:
                raise InputError(f"{path}: is no archive of a study; its first member is not {MANIFEST}.")
            manifest = json.loads(_read(tar, first))
            if manifest.get("format") != FORMAT:
                raise InputError(
                    f"{path}: has format {manifest.get('format')}, this version reads {FORMAT}; "
                    "use the version of wearscope named in its manifest."
                )
            waiting = dict(manifest["files"])
            while (member := tar.next()) is not None:
                name = PurePosixPath(member.name)
                if member.name not in waiting or name.is_absolute() or ".." in name.parts:
                    raise InputError(f"{path}: {member.name} is not in its manifest; get the file again.")
                content = _read(tar, member)
                if hashlib.sha256(content).hexdigest() != waiting.pop(member.name)["sha256"]:
                    raise InputError(
                        f"{path}: {member.name} is not what was packed (its checksum differs); get the file "
                        "again."
                    )
                visit(member.name, content)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; name an archive made by the target archive.") from error
    except (tarfile.TarError, json.JSONDecodeError, EOFError) as error:
        raise InputError(f"{path}: is no whole tar archive ({error}); get the file again.") from error
    if waiting:
        raise InputError(f"{path}: {min(waiting)} is missing; get the file again.")
    return manifest


def _read(tar: tarfile.TarFile, member: tarfile.TarInfo) -> bytes:
    file = tar.extractfile(member) if member.isfile() else None
    if file is None:
        raise InputError(f"{member.name} in the archive is no plain file; get the archive again.")
    return file.read()


def _member(name: str, size: int) -> tarfile.TarInfo:
    member = tarfile.TarInfo(name)
    member.size, member.mode = size, 0o644
    return member


def main(arguments: list[str] | None = None) -> int:
    """Command line; 1 where a comparison finds a difference or the input is bad."""
    parser = argparse.ArgumentParser(prog="python -m wearscope.archive", description="Archives of studies.")
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("verify", help="check every checksum").add_argument("file")
    unpack = commands.add_parser("unpack", help="check and unpack into a new folder")
    unpack.add_argument("file")
    unpack.add_argument("folder")
    compare = commands.add_parser("compare", help="compare two archives or result folders, table by table")
    compare.add_argument("a")
    compare.add_argument("b")
    given = parser.parse_args(arguments)
    try:
        if given.command == "compare":
            rows = compare_archives(given.a, given.b)
            with pd.option_context("display.max_colwidth", None, "display.width", None):
                print(rows.to_string(index=False) if len(rows) else "nothing to compare")
            return int(rows["outcome"].isin(["differs", "only in a", "only in b"]).any())
        if given.command == "unpack":
            manifest = unpack_archive(given.file, given.folder)
        else:
            manifest = verify_archive(given.file)
    except InputError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{given.file}: study {manifest['study']}, {len(manifest['files'])} files, every checksum holds")
    return 0


if __name__ == "__main__":
    sys.exit(main())
