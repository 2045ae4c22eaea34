"""Verifies, unpacks and restores the archive of a finished study.

An archive is an uncompressed tar file (Parquet and PNG are compressed already). Its first member,
``MANIFEST.json``, holds the configuration, the versions of code and packages, and the size and SHA-256 of
every file. The second, ``MANIFEST.sha256``, holds the manifest's own SHA-256, and ``config.yaml`` the
configuration. Equal content gives equal bytes.

    python -m wearscope.archive verify FILE
    python -m wearscope.archive unpack FILE FOLDER
    python -m wearscope.archive restore FILE
"""

import argparse
import sys
from pathlib import Path

from wearscope.archive.packing import CONFIG, Manifest, restore_archive, show, unpack_archive, walk_archive
from wearscope.errors import InputError
from wearscope.processes import end_process


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit status: 0, or 1 if the input is bad."""
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
    """Print what `restore_archive` returned."""
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
