"""An answer that is shown as a whole: the old one or the new one, whatever is killed in between.

Jobs make it in a folder of their own. Then its files take the place of the old ones together: a folder
`READY`, which appears in one step, holds them until each has its place. Whoever looks next finishes that.
"""

import fcntl
import json
import os
import shutil
from contextlib import suppress
from pathlib import Path

from wearscope.storage.checksums import ANSWERS, CHECKSUMS, check_file, record_checksums
from wearscope.storage.files import DamagedFile, set_aside, write_new, write_text

#: Where jobs make answers, next to the folders in which they are shown, and the list of its files.
MADE, LIST = ".made", "shown.json"
#: Held by the run that works in a folder of results.
LOCK = ".wearscope.lock"
#: What has taken its place or not yet, and what is still being gathered.
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
            shutil.copy2(file, gathered / name)
    write_new(gathered / LIST, json.dumps(names))
    gathered.replace(folder / READY)
    settle(folder)
    write_text(made / LIST, json.dumps(names))


def settle(folder: Path) -> None:
    """Finish what `show_answer` began in a folder before it was killed; nothing where it began nothing."""
    ready = folder / READY
    if not ready.is_dir():
        return
    with suppress(FileNotFoundError):  # of another that finishes it too
        names = json.loads((ready / LIST).read_text(encoding="utf-8"))
        for old in set(_list_shown(folder)).difference(names):
            (folder / old).unlink(missing_ok=True)
        for name in names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            if (ready / name).exists():
                os.replace(ready / name, folder / name)
            set_aside(folder / name).unlink(missing_ok=True)
        made = folder.parent / MADE / folder.name
        record_checksums(folder.parent, [folder / name for name in names], made / LIST)
        os.replace(ready / LIST, folder / f".{LIST}")
    shutil.rmtree(ready, ignore_errors=True)


def forget_lost(made: Path, folder: Path) -> None:
    """Mark an answer as not shown yet where one of its files is lost, so that it is shown again."""
    if (made / LIST).is_file() and not all((folder / name).is_file() for name in _list_shown(folder)):
        (made / LIST).unlink()


def check_shown(path: str | Path) -> None:
    """Check a file that is about to be shown, by the checksum that a folder above it keeps; else it passes.

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


def _list_shown(folder: Path) -> list[str]:
    """Files of the answer that a folder shows."""
    kept = folder / f".{LIST}"
    if kept.is_file():
        return [str(name) for name in json.loads(kept.read_text(encoding="utf-8"))]
    return [file.name for pattern in _EARLIER for file in folder.glob(pattern)]
