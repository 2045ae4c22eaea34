"""Checksums of what a study's jobs write, kept in its folder.

The checksum of ``results/NAME/a/b.json`` is in ``results/NAME/.checksums/a/b.json.sha256``, as
`sha256sum` writes it.
"""

import json
import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from wearscope import limits
from wearscope.storage.files import DamagedFile, check_plain, digest_file, set_aside, write_text

CHECKSUMS = ".checksums"
RECORDING = "recording.parquet"
#: What pages of an answer lie next to, and what each answers.
ANSWERS = {
    "verdict.json": "diagnosis",
    "tracking.json": "tracking",
    "detection.json": "detection",
    "conclusion.json": "study",
    "reevaluation.parquet": "correction",
}
#: The configuration that a study was run with last, in its folder.
SETTINGS = ".study.json"


def record_checksums(
    folder: str | Path,
    files: Iterable[str | Path],
    made_with: str | Path = "",
    write: Callable[[Path, str], object] = write_text,
) -> None:
    """Keep the checksums of files in a study's folder.

    Parameters
    ----------
    folder, files
    made_with : path-like
        Output of a rule whose job wrote them, where they are no outputs themselves.
    write : callable
        Writes a text file; `wearscope.storage.files.write_new` is faster in a folder that only one writes to.
    """
    for file in map(Path, files):
        name = file.relative_to(folder).as_posix()
        output = Path(made_with).relative_to(folder).as_posix() if made_with else ""
        line = f"# made with {output}\n" if output else ""
        write(_kept(folder, name), f"{digest_file(file)}  {name}\n{line}")


def find_output(path: Path) -> Path:
    """The output of a rule that a file was made with: itself, where no kept checksum says another."""
    for folder in path.parents:
        if (folder / CHECKSUMS).is_dir():
            try:
                lines = _read_kept(_kept(folder, path.relative_to(folder).as_posix()))
            except (OSError, ValueError):
                break
            _, found, output = lines.partition("# made with ")
            return folder / output.strip() if found else path
    return path


def check_file(folder: str | Path, file: str | Path) -> None:
    """Check a file in a study's folder; one without a kept checksum passes.

    Raises
    ------
    DamagedFile
        Where it is missing, or is not what was written.
    """
    name = Path(file).relative_to(folder).as_posix()
    kept = _kept(folder, name)
    try:
        if not os.path.lexists(kept):
            return
        wanted = _read_kept(kept).split()[:1]
    except (OSError, ValueError):
        wanted = []
    if not Path(file).is_file():
        raise DamagedFile(file, f"{file}: no such file, though it was written; make it again.")
    if [digest_file(Path(file))] != wanted:
        raise DamagedFile(
            file, f"{file}: is not what was written (its checksum differs); delete it and make it again."
        )


def withdraw(path: str | Path) -> list[Path]:
    """Set a damaged file aside, so that the next run makes it again.

    A recording's chunk is withdrawn too: its marker says that the recording is there.

    Returns
    -------
    list of Path
        The files that a run must make: what was withdrawn and is an output of a rule.
    """
    path = Path(path)
    withdrawn = [find_output(path)]
    if path.name == RECORDING:
        withdrawn = [marker for marker in path.parents[1].glob("_chunk-*.json") if _lists(marker, path)]
    for file in {path, *withdrawn}:
        with suppress(FileNotFoundError):
            file.replace(set_aside(file))
    return withdrawn


def _lists(marker: Path, recording: Path) -> bool:
    point = recording.parent.name.removeprefix("point=")
    try:
        return point in json.loads(marker.read_text(encoding="utf-8"))["fingerprints"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return True  # an unreadable marker proves nothing


def _read_kept(path: Path) -> str:
    check_plain(path, limits.YAML_BYTES, "make its file again")
    return path.read_text(encoding="utf-8")


def _kept(folder: str | Path, name: str) -> Path:
    return Path(folder) / CHECKSUMS / f"{name}.sha256"
