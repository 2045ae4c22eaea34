"""Files written whole or not at all, their checksums, and answers that are shown as a whole.

What a killed writer left is cleared by the next one. The checksum of ``results/NAME/a/b.json`` is in
``results/NAME/.checksums/a/b.json.sha256``, as `sha256sum` writes it.

An answer is shown as a whole: the old one or the new one, whatever is killed in between. Jobs make it in a
folder of their own, those of a study in its ``parts``. Then its files take the place of the old ones
together: a folder `READY`, which appears in one step, holds them until each has its place. If the process is
killed meanwhile, the next one that looks finishes the move.
"""

import errno
import fcntl
import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from wearscope import limits
from wearscope.errors import InputError, describe

#: The disk is full, or its user's share of it is.
FULL = (errno.ENOSPC, errno.EDQUOT)
#: Names of files being written, and of files set aside as damaged.
OWN = re.compile(r"\..+\.(?:[a-z0-9_]{8}\.part|damaged)")


#: Files that this process has written; a job keeps their checksums.
written: set[Path] = set()


class DamagedFile(InputError):
    """A file of a study that is missing or is not what was written.

    Attributes
    ----------
    path : Path
    """

    def __init__(self, path: str | Path, message: str) -> None:
        super().__init__(message)
        self.path = Path(path)

    def __reduce__(self) -> tuple[type, tuple[Path, str]]:
        return type(self), (self.path, str(self))


def check_folder(path: str | Path) -> None:
    """Refuse a path at which no folder can be made, because a file or a broken link is in the way.

    Raises
    ------
    InputError
        Where a part of it is a file, or a link to nowhere.
    """
    path = Path(path)
    for part in (*reversed(path.parents), path):
        if not part.is_dir() and os.path.lexists(part):
            what = "a link to nowhere" if part.is_symlink() and not part.exists() else "a file, no folder"
            raise InputError(f"{part}: is {what}; move it away, results are written there.")


def write_whole(path: str | Path, write: Callable[[str], Any]) -> None:
    """Write a file under a temporary name in the same folder, then rename it.

    Temporary files that killed writers left in the folder are removed. A writer holds a lock on its own,
    which the kernel releases when it dies.

    Parameters
    ----------
    path : path-like
        The file to write; its folder is made.
    write : callable
        Called with the temporary name; writes the content.

    Raises
    ------
    InputError
        Where the disk refuses the file; nothing is left behind.
    """
    path = Path(path)
    handle, temporary = -1, ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        clear_stale(path.parent)
        handle, temporary = _open_locked(path)
        write(temporary)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
        set_aside(path).unlink(missing_ok=True)
        written.add(path)
    except OSError as error:
        raise explain_unwritten(path, error) from error
    finally:
        if temporary and os.path.exists(temporary):
            os.unlink(temporary)
        if handle >= 0:
            os.close(handle)


def explain_unwritten(path: str | Path, error: OSError) -> InputError:
    """Sentence about a file or folder that cannot be written; a full disk is named by where it is mounted."""
    if error.errno not in FULL:
        told = error.strerror or error
        return InputError(f"{path}: cannot be written ({told}); free disk space or choose another place.")
    place = Path(error.filename2 or error.filename or path).absolute()  # filename2: the target of a copy
    while not place.exists() or (not os.path.ismount(place) and place != place.parent):
        place = place.parent
    return InputError(f"{path}: the disk at {place} is full ({error.strerror}); free disk space there.")


def copy_file(source: str | Path, target: str | Path) -> str | Path:
    """Copy a file's content; for `shutil.copytree`, which would make a list of errors of a full disk.

    Raises
    ------
    InputError
        Where the disk is full.
    """
    try:
        return shutil.copyfile(source, target)
    except OSError as error:
        if error.errno not in FULL:
            raise
        raise explain_unwritten(target, error) from error


def write_text(path: str | Path, text: str) -> None:
    """Write a text file whole or not at all."""
    write_whole(path, lambda name: Path(name).write_text(text, encoding="utf-8"))


def open_new(path: str | Path) -> IO[str]:
    """Open a new text file in place of what is there; a link is not followed, a pipe not waited for.

    Raises
    ------
    OSError
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    return path.open("x", encoding="utf-8")


def write_new(path: str | Path, text: str) -> None:
    """Write a text file as `open_new` opens it, where nobody looks before all is written."""
    with open_new(path) as file:
        file.write(text)


def load_json(text: str | bytes, **options: Any) -> Any:
    """Content of a JSON text, not nested too deeply to be walked, and fit to be written again.

    Parameters
    ----------
    text : str or bytes
    **options
        Of `json.loads`.

    Raises
    ------
    ValueError, RecursionError
    """
    text = text if isinstance(text, str) else text.decode()
    content = json.loads(text, **options)
    _check_depth(content)
    if re.search(r"\\u[dD][89a-fA-F]", text):  # refuses half a surrogate pair, which no file can hold
        json.dumps(content, ensure_ascii=False).encode()
    return content


def _check_depth(content: Any) -> None:
    level, depth = [content], 0
    while level := [inner for one in level for inner in _list_inner(one)]:
        depth += 1
        if depth > limits.JSON_DEPTH:
            raise ValueError(f"is nested more than {limits.JSON_DEPTH} deep")


def _list_inner(one: Any) -> Iterable[Any]:
    return one.values() if isinstance(one, dict) else one if isinstance(one, list) else ()


def check_plain(path: str | Path, most: int, remedy: str) -> None:
    """Refuse what is no plain file of a bounded size: a pipe or device has no end.

    Parameters
    ----------
    path : path-like
    most : int
        Largest size [bytes].
    remedy : str

    Raises
    ------
    InputError
    """
    path = Path(path)
    try:
        there, plain = path.exists(), path.is_file()
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be looked at ({type(error).__name__}); {remedy}.") from None
    if not plain:
        told = "is no plain file" if there else "no such file"
        raise InputError(f"{path}: {told}; {remedy}.")
    if path.stat().st_size > most:
        raise InputError(f"{path}: is larger than {most / 1e6:g} MB; {remedy}.")


def read_json(path: str | Path, kind: type = dict) -> Any:
    """Content of a JSON file that holds a mapping, or another `kind`.

    Raises
    ------
    InputError
        Where it is missing, no plain file, larger than `wearscope.limits` says, or none.
    """
    path = Path(path)
    check_plain(path, limits.JSON_BYTES, "run the command that makes it")
    try:
        content = load_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: is no JSON ({describe(error)}); make it again.") from None
    if not isinstance(content, kind):
        raise InputError(f"{path}: holds no fields; make it again.")
    return content


def clear_stale(folder: str | Path) -> list[Path]:
    """Remove the temporary files of writers that are no more; return what was removed.

    Only files of the pattern that `write_whole` uses, and only where no process holds their lock.
    """
    removed = []
    with os.scandir(folder) as entries:
        names = [
            entry.name for entry in entries if entry.name.endswith(".part") and OWN.fullmatch(entry.name)
        ]
    for name in names:
        path = Path(folder) / name
        with suppress(OSError):  # gone in the meantime, or its writer lives
            handle = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                path.unlink()
                removed.append(path)
            finally:
                os.close(handle)
    return removed


def digest_file(path: Path) -> str:
    """SHA-256 of a file, read in blocks."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def set_aside(path: str | Path) -> Path:
    """Name under which a damaged file is kept until it is written again."""
    path = Path(path)
    return path.with_name(f".{path.name}.damaged")


def _open_locked(path: Path) -> tuple[int, str]:
    while True:
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
        fcntl.flock(handle, fcntl.LOCK_EX)
        if os.fstat(handle).st_nlink:
            return handle, temporary
        os.close(handle)  # removed as stale before it was locked


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
