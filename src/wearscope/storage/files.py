"""Writes files atomically, keeps their checksums, and replaces the files of an answer together.

The next writer removes the temporary file of a writer that was killed. The checksum of
``results/NAME/a/b.json`` is in ``results/NAME/.checksums/a/b.json.sha256``, in the format of `sha256sum`.

An answer is a set of files, such as a verdict with its page. A user sees all files of the old answer or all
of the new one, even if a process is killed in between. Jobs first make the new files in a separate folder
(those of a study in its ``parts``). `show_answer` then copies them and renames the folder of copies to
`READY` in one step. From there each file moves to its place. If the process is killed during these moves,
the next process that reads the answer finishes them (`settle`).
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

#: Error numbers of a full disk and of a user's used-up quota.
FULL = (errno.ENOSPC, errno.EDQUOT)
#: Pattern of the names of temporary files (see `write_whole`) and of damaged files (see `set_aside`).
OWN = re.compile(r"\..+\.(?:[a-z0-9_]{8}\.part|damaged)")


#: Files that this process has written. At its end a job records their checksums.
written: set[Path] = set()


class DamagedFile(InputError):
    """Error about a file of a study that is missing or has changed since it was written.

    Attributes
    ----------
    path : Path
        The file.
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
        If a part of the path is a file, or a link whose target does not exist.
    """
    path = Path(path)
    for part in (*reversed(path.parents), path):
        if not part.is_dir() and os.path.lexists(part):
            what = "a link to nowhere" if part.is_symlink() and not part.exists() else "a file, no folder"
            raise InputError(f"{part}: is {what}; move it away, results are written there.")


def write_whole(path: str | Path, write: Callable[[str], Any]) -> None:
    """Write a file under a temporary name in the same folder, then rename it.

    First removes the temporary files of killed writers. A living writer's file is safe: the writer locks it,
    and the kernel releases the lock only when the writer ends.

    Parameters
    ----------
    path : path-like
        The file to write; its folder is created.
    write : callable
        Called with the temporary name; writes the content.

    Raises
    ------
    InputError
        If the file cannot be written; no temporary file remains.
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
    """Return the error for a file or folder that cannot be written; it says where a full disk is mounted."""
    if error.errno not in FULL:
        told = error.strerror or error
        return InputError(f"{path}: cannot be written ({told}); free disk space or choose another place.")
    place = Path(error.filename2 or error.filename or path).absolute()  # filename2: the target of a copy
    while not place.exists() or (not os.path.ismount(place) and place != place.parent):
        place = place.parent
    return InputError(f"{path}: the disk at {place} is full ({error.strerror}); free disk space there.")


def copy_file(source: str | Path, target: str | Path) -> str | Path:
    """Copy a file's content; meant for `shutil.copytree`, which collects an `OSError` for every file.

    Raises
    ------
    InputError
        If the disk is full; it stops the copying at the first file.
    """
    try:
        return shutil.copyfile(source, target)
    except OSError as error:
        if error.errno not in FULL:
            raise
        raise explain_unwritten(target, error) from error


def write_text(path: str | Path, text: str) -> None:
    """Write a text file atomically (see `write_whole`)."""
    write_whole(path, lambda name: Path(name).write_text(text, encoding="utf-8"))


def open_new(path: str | Path) -> IO[str]:
    """Delete what has this path and open a new text file; so a link is not followed and a pipe cannot block.

    Raises
    ------
    OSError
        If the old file cannot be deleted or the new one cannot be created.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    return path.open("x", encoding="utf-8")


def write_new(path: str | Path, text: str) -> None:
    """Write a text file directly (see `open_new`), for folders that nobody reads before all is written."""
    with open_new(path) as file:
        file.write(text)


def load_json(text: str | bytes, **options: Any) -> Any:
    """Parse a JSON text; refuse deep nesting, and half surrogate pairs, which no file can hold.

    Parameters
    ----------
    text : str or bytes
    **options
        Options of `json.loads`.

    Raises
    ------
    ValueError, RecursionError
        If the text is no JSON, or is refused.
    """
    text = text if isinstance(text, str) else text.decode()
    content = json.loads(text, **options)
    _check_depth(content)
    if re.search(r"\\u[dD][89a-fA-F]", text):  # encoding fails for half a surrogate pair
        json.dumps(content, ensure_ascii=False).encode()
    return content


def _check_depth(content: Any) -> None:
    """Refuse a JSON content with more than `limits.JSON_DEPTH` levels."""
    level, depth = [content], 0
    while level := [inner for one in level for inner in _list_inner(one)]:
        depth += 1
        if depth > limits.JSON_DEPTH:
            raise ValueError(f"is nested more than {limits.JSON_DEPTH} deep")


def _list_inner(one: Any) -> Iterable[Any]:
    """Return the values inside a JSON value; nothing for a text, number or null."""
    return one.values() if isinstance(one, dict) else one if isinstance(one, list) else ()


def check_plain(path: str | Path, most: float, remedy: str) -> None:
    """Refuse a path that is no regular file, or a file that is too large; reading a pipe may never end.

    Parameters
    ----------
    path : path-like
    most : float
        Largest size [bytes].
    remedy : str
        What the user can do, for the message.

    Raises
    ------
    InputError
        If it is refused.
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


def read_json(path: str | Path, kind: type = dict, missing: str = "run the command that makes it") -> Any:
    """Read a JSON file whose content is of type `kind`; `missing` is the remedy where there is no such file.

    Raises
    ------
    InputError
        If the file is missing, no regular file, too large, no JSON, or of another type.
    """
    path = Path(path)
    check_plain(path, limits.JSON_BYTES, missing)
    try:
        content = load_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: is no JSON ({describe(error)}); make it again.") from None
    if not isinstance(content, kind):
        raise InputError(f"{path}: holds no fields; make it again.")
    return content


def clear_stale(folder: str | Path) -> list[Path]:
    """Remove temporary files of `write_whole` that no process locks: their writer was killed.

    Returns
    -------
    list of Path
        Removed files.
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
    """Return the SHA-256 of a file, as hexadecimal digits."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def set_aside(path: str | Path) -> Path:
    """Return the path under which a damaged file is kept until it is written again."""
    path = Path(path)
    return path.with_name(f".{path.name}.damaged")


def _open_locked(path: Path) -> tuple[int, str]:
    """Create a temporary file for `path` and lock it; return its descriptor and name."""
    while True:
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
        fcntl.flock(handle, fcntl.LOCK_EX)
        if os.fstat(handle).st_nlink:
            return handle, temporary
        os.close(handle)  # another process removed it as stale before this one locked it


CHECKSUMS = ".checksums"
RECORDING = "recording.parquet"
#: Main file of each kind of answer, and the name of that kind. Its pages are in the same folder.
ANSWERS = {
    "verdict.json": "diagnosis",
    "tracking.json": "tracking",
    "detection.json": "detection",
    "conclusion.json": "study",
    "reevaluation.parquet": "correction",
}
#: File in a study's folder with the configuration of its last run.
SETTINGS = ".study.json"


def record_checksums(
    folder: str | Path,
    files: Iterable[str | Path],
    made_with: str | Path = "",
    write: Callable[[Path, str], object] = write_text,
) -> None:
    """Record the checksums of files in a study's folder.

    Parameters
    ----------
    folder : path-like
        The study's folder.
    files : iterable of path-like
        Files in it.
    made_with : path-like
        Declared output of the workflow rule whose job wrote the files, if they are not declared themselves.
        Deleting this output makes the workflow write them again.
    write : callable
        Writes a text file; `write_new` is faster but needs a folder that only this process writes to.
    """
    for file in map(Path, files):
        name = file.relative_to(folder).as_posix()
        output = Path(made_with).relative_to(folder).as_posix() if made_with else ""
        line = f"# made with {output}\n" if output else ""
        write(_locate_checksum(folder, name), f"{digest_file(file)}  {name}\n{line}")


def find_output(path: Path) -> Path:
    """Return the declared output of the rule that made a file: itself, or ``made_with`` (see above)."""
    for folder in path.parents:
        if (folder / CHECKSUMS).is_dir():
            try:
                lines = _read_checksum(_locate_checksum(folder, path.relative_to(folder).as_posix()))
            except (OSError, ValueError):
                break
            _, found, output = lines.partition("# made with ")
            return folder / output.strip() if found else path
    return path


def check_file(folder: str | Path, file: str | Path) -> None:
    """Check a file in a study's folder against its recorded checksum; without one, the file passes.

    Raises
    ------
    DamagedFile
        If the file is missing or has changed.
    """
    name = Path(file).relative_to(folder).as_posix()
    kept = _locate_checksum(folder, name)
    try:
        if not os.path.lexists(kept):
            return
        wanted = _read_checksum(kept).split()[:1]
    except (OSError, ValueError):
        wanted = []
    if not Path(file).is_file():
        raise DamagedFile(file, f"{file}: no such file, though it was written; make it again.")
    if [digest_file(Path(file))] != wanted:
        raise DamagedFile(
            file, f"{file}: is not what was written (its checksum differs); delete it and make it again."
        )


def withdraw(path: str | Path) -> list[Path]:
    """Rename a damaged file, so that the next run makes it again.

    For a recording, the marker file of its chunk is renamed too, since it states that the recording exists.

    Returns
    -------
    list of Path
        Declared outputs of rules that the next run must make again.
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
    """Return whether a chunk's marker file lists a recording, or cannot be read."""
    point = recording.parent.name.removeprefix("point=")
    try:
        return point in json.loads(marker.read_text(encoding="utf-8"))["fingerprints"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return True  # it may list the recording, so the chunk is made again


def _read_checksum(path: Path) -> str:
    """Return the content of a checksum file."""
    check_plain(path, limits.YAML_BYTES, "make its file again")
    return path.read_text(encoding="utf-8")


def _locate_checksum(folder: str | Path, name: str) -> Path:
    """Return the checksum file of a file, given by its path in the study's folder."""
    return Path(folder) / CHECKSUMS / f"{name}.sha256"


#: Folder in which jobs make answers, next to the folders that show them.
MADE = ".made"
#: File that lists the files of an answer.
LIST = "shown.json"
#: File that a run locks while it works in a folder of results.
LOCK = ".wearscope.lock"
#: Folder with the complete files of a new answer, and its name while files are copied into it.
READY, GATHERED = ".ready", ".gathered"
#: Files of an answer made by a version that wrote no list.
_EARLIER = ("report.html", "*.parquet", "next_measurement_*")


def show_answer(made: Path, folder: Path) -> None:
    """Replace the answer in a folder by a new one, all files together.

    Parameters
    ----------
    made : Path
        Folder in which jobs have made the new answer; its files stay there, and their list is added.
    folder : Path
        Folder that shows the answer.
    """
    settle(folder)
    gathered, names = folder / GATHERED, []
    shutil.rmtree(gathered, ignore_errors=True)
    for file in sorted(made.rglob("*")):
        name = file.relative_to(made)
        if file.is_file() and file.name != LIST and not file.name.startswith("."):
            names.append(name.as_posix())
            (gathered / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, gathered / name)  # a copy is dated now, when the answer is shown
    write_new(gathered / LIST, json.dumps(names))
    gathered.replace(folder / READY)
    settle(folder)
    write_text(made / LIST, json.dumps(names))


def settle(folder: Path) -> None:
    """Finish the moves into a folder that a killed `show_answer` has left; do nothing if there are none."""
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
        places, made = [folder, *folder.parents], made_in(folder)
        root = next((one for one in places if (one / CHECKSUMS).is_dir()), folder.parent)
        record_checksums(root, [folder / name for name in names], made / LIST if made.is_dir() else "")
        os.replace(ready / LIST, folder / f".{LIST}")
    shutil.rmtree(ready, ignore_errors=True)


def forget_lost(made: Path, folder: Path) -> None:
    """If a shown file is missing, delete the list of its answer, so that the next run shows it again."""
    if (made / LIST).is_file() and not all((folder / name).is_file() for name in _list_shown(folder)):
        (made / LIST).unlink()


def check_shown(path: str | Path) -> None:
    """Check a file that is about to be shown against the checksum recorded in a folder above it, if any.

    Raises
    ------
    DamagedFile
        If the file has changed, or is missing, perhaps because a run is making it.
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
    """Check a page that is about to be shown, and the answer in the same folder that it was made from.

    Raises
    ------
    DamagedFile
        See `check_shown`.
    """
    for name in (*ANSWERS, Path(page).name):
        check_shown(Path(page).with_name(name))


def _is_busy(path: Path) -> bool:
    """Return whether a run is working in the folder of results that holds a file."""
    for folder in path.parents:
        if (folder / LOCK).is_file():
            with suppress(OSError), open(folder / LOCK) as file:
                try:
                    fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
                except BlockingIOError:
                    return True
    return False


def made_in(folder: Path) -> Path:
    """Return the folder in which jobs make the answer of a given folder; a study uses its own instead."""
    return folder.parent / MADE / folder.name


def _list_shown(folder: Path) -> list[str]:
    """List the files of the answer that a folder shows, as paths in it."""
    kept = folder / f".{LIST}"
    if kept.is_file():
        return [str(name) for name in json.loads(kept.read_text(encoding="utf-8"))]
    return [file.name for pattern in _EARLIER * made_in(folder).is_dir() for file in folder.glob(pattern)]
