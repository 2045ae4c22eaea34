"""Files written whole or not at all; what a killed writer left is cleared by the next one."""

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
