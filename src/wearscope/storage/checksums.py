"""Checksums of what a study's jobs write, kept in its folder.

The checksum of ``results/NAME/a/b.json`` is in ``results/NAME/.checksums/a/b.json.sha256``, as
`sha256sum` writes it.

An answer is shown as a whole: the old one or the new one, whatever is killed in between. Jobs make it in a
folder of their own, those of a study in its ``parts``. Then its files take the place of the old ones
together: a folder `READY`, which appears in one step, holds them until each has its place. If the process is
killed meanwhile, the next one that looks finishes the move.
"""

import fcntl
import json
import os
import shutil
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from wearscope import limits
from wearscope.storage.files import DamagedFile, check_plain, digest_file, set_aside, write_new, write_text

CHECKSUMS = ".checksums"
RECORDING = "recording.parquet"
#: File next to which the pages of an answer lie, and the kind of the answer.
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
    """Output of the rule that made a file: the file itself unless its checksum names another."""
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
        Files that a run must make again: those withdrawn that are outputs of a rule.
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


#: Where jobs make answers, next to the folders in which they are shown, and the list of its files.
MADE, LIST = ".made", "shown.json"
#: Held by the run that works in a folder of results.
LOCK = ".wearscope.lock"
#: Folder of files that are about to take their places, and its name while it is being filled.
READY, GATHERED = ".ready", ".gathered"
#: Files of an answer from before lists were kept.
_EARLIER = ("report.html", "*.parquet", "next_measurement_*")


def show_answer(made: Path, folder: Path) -> None:
    """Put the files of an answer in the place of the one that a folder shows, all together.

    Parameters
    ----------
    made : Path
        Where jobs have made it; keeps it, and gets the list of its files.
    folder : Path
    """
    settle(folder)
    gathered, names = folder / GATHERED, []
    shutil.rmtree(gathered, ignore_errors=True)
    for file in sorted(made.rglob("*")):
        name = file.relative_to(made)
        if file.is_file() and file.name != LIST and not file.name.startswith("."):
            names.append(name.as_posix())
            (gathered / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, gathered / name)  # so that its date is that of the showing
    write_new(gathered / LIST, json.dumps(names))
    gathered.replace(folder / READY)
    settle(folder)
    write_text(made / LIST, json.dumps(names))


def settle(folder: Path) -> None:
    """Finish what a killed `show_answer` began in a folder, if there is anything."""
    ready = folder / READY
    if not ready.is_dir():
        return
    with suppress(FileNotFoundError):  # another process may finish it at the same time
        names = json.loads((ready / LIST).read_text(encoding="utf-8"))
        for old in set(_list_shown(folder)).difference(names):
            (folder / old).unlink(missing_ok=True)
        for name in names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            if (ready / name).exists():
                os.replace(ready / name, folder / name)
            set_aside(folder / name).unlink(missing_ok=True)
        places, made = [folder, *folder.parents], _made_in(folder)
        root = next((one for one in places if (one / CHECKSUMS).is_dir()), folder.parent)
        record_checksums(root, [folder / name for name in names], made / LIST if made.is_dir() else "")
        os.replace(ready / LIST, folder / f".{LIST}")
    shutil.rmtree(ready, ignore_errors=True)


def forget_lost(made: Path, folder: Path) -> None:
    """Mark an answer as not shown yet where one of its files is lost, so that it is shown again."""
    if (made / LIST).is_file() and not all((folder / name).is_file() for name in _list_shown(folder)):
        (made / LIST).unlink()


def check_shown(path: str | Path) -> None:
    """Check a file that is about to be shown, by the checksum kept in a folder above it, if there is any.

    Raises
    ------
    DamagedFile
        As of `check_file`.
    """
    path = Path(path).absolute()
    settle(path.parent)
    for folder in path.parents:
        if (folder / CHECKSUMS).is_dir():
            try:
                check_file(folder, path)
            except DamagedFile:
                if path.is_file() or not _is_busy(path):
                    raise
                told = f"{path}: is being made; look again when the run has ended."
                raise DamagedFile(path, told) from None


def check_answer(page: str | Path) -> None:
    """Check a page that is about to be shown, and the answer next to it that it was made from.

    Raises
    ------
    DamagedFile
        As of `check_file`.
    """
    for name in (*ANSWERS, Path(page).name):
        check_shown(Path(page).with_name(name))


def _is_busy(path: Path) -> bool:
    """Whether a run works in the folder of results that a file is in."""
    for folder in path.parents:
        if (folder / LOCK).is_file():
            with suppress(OSError), open(folder / LOCK) as file:
                try:
                    fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
                except BlockingIOError:
                    return True
    return False


def _made_in(folder: Path) -> Path:
    """Where jobs make the answer of a folder next to others; a study makes its own within itself."""
    return folder.parent / MADE / folder.name


def _list_shown(folder: Path) -> list[str]:
    """Files of the answer that a folder shows."""
    kept = folder / f".{LIST}"
    if kept.is_file():
        return [str(name) for name in json.loads(kept.read_text(encoding="utf-8"))]
    return [file.name for pattern in _EARLIER * _made_in(folder).is_dir() for file in folder.glob(pattern)]
