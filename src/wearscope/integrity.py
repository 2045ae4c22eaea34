"""Checks all files that a study's jobs have written.

    python -m wearscope.integrity results/NAME              list missing and damaged files
    python -m wearscope.integrity results/NAME --set-aside  and rename them, so that a run makes them again

Files are compared with their recorded checksums (`wearscope.storage.files`). Recordings are compared with
the fingerprints in the marker file of their chunk.
"""

import argparse
import shlex
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from wearscope.home import find_home
from wearscope.processes import end_process
from wearscope.simulation.chunk import read_markers
from wearscope.simulation.recording import point_path, read_fingerprint
from wearscope.storage.files import (
    CHECKSUMS,
    SETTINGS,
    DamagedFile,
    check_file,
    clear_stale,
    read_json,
    withdraw,
)


def find_damage(folder: str | Path) -> Iterator[DamagedFile]:
    """Yield an error for each file of a study that is missing or damaged.

    Parameters
    ----------
    folder : path-like
        The study's folder, e.g. ``results/paper``.
    """
    folder = Path(folder)
    kept = folder / CHECKSUMS
    for file in sorted(kept.rglob("*.sha256")):
        if _is_dropped(folder, file.relative_to(kept).with_suffix("")):
            continue
        try:
            check_file(folder, folder / file.relative_to(kept).with_suffix(""))
        except DamagedFile as error:
            yield error
    for traces in ("traces", "partitions/*/traces"):
        for marker in sorted(folder.glob(f"{traces}/*/*/*/_chunk-*.json")):
            packed = kept / marker.with_suffix(".tar.sha256").relative_to(folder)
            if not packed.is_file():  # packed recordings have a checksum, which was checked above
                yield from _check_recordings(marker)


def _is_dropped(folder: Path, file: Path) -> bool:
    """Return whether a missing file held recordings that the study, by its settings, deletes after use."""
    traced = file.suffix == ".tar" and "traces" in file.parts
    gone = (traced or file.parts[-3:-1] == ("reevaluation", "traces")) and not (folder / file).exists()
    if not gone or not (folder / SETTINGS).is_file():
        return False
    simulation = read_json(folder / SETTINGS).get("simulation", {})
    return not (simulation.get("keep_recordings") or simulation.get("packed"))


def _check_recordings(marker: Path) -> Iterator[DamagedFile]:
    """Yield an error for each missing or damaged recording of a chunk, or for its marker file."""
    try:
        fingerprints, failed = read_markers([marker])
    except DamagedFile as error:
        yield error
        return
    for (name, point), wanted in fingerprints.items():
        path = point_path(marker.parents[1], name, point)
        if (name, point) not in failed and read_fingerprint(path) != wanted:
            what = "is not what was written" if path.exists() else "no such file, though it was written"
            yield DamagedFile(path, f"{path}: {what}; simulate its point again.")


def explain_repair(folder: Path, files: Sequence[str]) -> str:
    """Return a sentence with the command that makes files of a study again."""
    settings = folder / SETTINGS
    if not settings.is_file():
        return f"the command that made {', '.join(files)} makes them again."
    root = folder.resolve().parents[1]
    command = ["snakemake", "--cores", "2"]
    if not (root / "Snakefile").is_file():
        home = find_home()
        command += ["--snakefile", str(home / "Snakefile")]
        command += ["--workflow-profile", str(home / "profiles" / "default")]
    if root != Path.cwd():
        command += ["--directory", str(root)]
    names = [str(Path(file).resolve().relative_to(root)) for file in files]
    return f"make it again: {shlex.join([*command, '--configfile', str(settings.resolve()), '--', *names])}"


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return 1 if a file is missing or damaged, or there are no checksums, else 0."""
    parser = argparse.ArgumentParser(
        prog="python -m wearscope.integrity", description="Check all that a study's jobs have written."
    )
    parser.add_argument("folder", help="the study's results, e.g. results/paper")
    parser.add_argument("--set-aside", action="store_true", help="set what is damaged aside")
    given = parser.parse_args(arguments)
    folder = Path(given.folder)
    if not folder.is_dir():
        print(f"{folder}: no such folder; name a study's results, e.g. results/paper.", file=sys.stderr)
        return 1
    for place in [folder, *(one for one in sorted(folder.rglob("*")) if one.is_dir())]:
        for removed in clear_stale(place):
            print(f"{removed}: removed, a killed job had left it")
    kept = sum(1 for _ in (folder / CHECKSUMS).rglob("*.sha256"))
    if not kept:
        told = "holds no checksums, so that nothing in it can be checked; name a folder directly below a"
        print(f"{folder}: {told} project's results, and copy hidden files along.", file=sys.stderr)
        return 1
    damaged = list(find_damage(folder))
    for error in damaged:
        print(error, file=sys.stderr)
    if not damaged:
        print(f"{folder}: {kept} files, every checksum holds")
        return 0
    if given.set_aside:
        again = sorted({str(file) for error in damaged for file in withdraw(error.path)})
        print(f"set aside; {explain_repair(folder, again)}", file=sys.stderr)
    else:
        command = shlex.join(["python", "-P", "-m", "wearscope.integrity", str(folder), "--set-aside"])
        print(f"have it made again: {command}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    end_process(main())
