"""Files that a data set names: paths inside its folder, their digest, their text."""

import hashlib
from collections.abc import Mapping
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from wearscope import limits
from wearscope.errors import InputError
from wearscope.storage.files import check_plain, digest_file


def find_inside(folder: Path, name: str, where: str) -> Path:
    """Path of a file that a data set names.

    Parameters
    ----------
    folder : Path
        The data set's folder.
    name : str
        As `dataset.yaml` has it.
    where : str
        File and field, for the sentence.

    Raises
    ------
    InputError
        Where the path is absolute, leads out of the folder (also by a link), or is empty.
    """
    plain = PurePosixPath(name)
    parts = [*plain.parts, *PureWindowsPath(name).parts]
    odd = not name.strip() or "\0" in name or not name.isprintable() or len(name) > limits.PATH
    if odd or plain.is_absolute() or PureWindowsPath(name).anchor or ".." in parts:
        raise InputError(
            f"{where}: '{name[:100] if name.isprintable() else ascii(name[:100])}' does not lie in the data "
            "set's folder; put the file there and give its path from there."
        )
    path = folder / name
    try:
        leaves = not path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError) as error:
        raise InputError(f"{where}: '{name[:100]}' cannot be followed ({type(error).__name__}).") from error
    if leaves:
        raise InputError(
            f"{where}: '{name}' is a link that leads out of the data set's folder; put the file itself there."
        )
    return path


def list_named(content: Mapping[str, Any]) -> list[str]:
    """Files that the fields of a `dataset.yaml` name, each once: URDF, recordings, own effects."""
    robot, runs = content.get("robot"), content.get("runs")
    names = [robot.get("urdf")] if isinstance(robot, Mapping) else []
    names += [run.get("file") for run in runs if isinstance(run, Mapping)] if isinstance(runs, list) else []
    for field in ("effects", "declared_effects"):
        listed = content.get(field)
        names += [name for name in listed if str(name).endswith(".py")] if isinstance(listed, list) else []
    return list(dict.fromkeys(name for name in names if isinstance(name, str)))


def digest_dataset(folder: Path, content: Mapping[str, Any]) -> str:
    """SHA-256 of a data set: of ``dataset.yaml`` and of each file that it names.

    Parameters
    ----------
    folder : Path
    content : mapping
        Content of ``dataset.yaml``.

    Returns
    -------
    str
        SHA-256 of the lines ``<SHA-256 of the file>  <name>``, sorted by name; a missing file has no line.
    """
    lines = []
    for name in sorted({"dataset.yaml", *list_named(content)}):
        file = find_inside(folder, name, "dataset.yaml")
        if file.is_file():
            lines.append(f"{digest_file(file)}  {name}\n")
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def read_text(path: Path, remedy: str) -> str:
    """Text of a file.

    Raises
    ------
    InputError
        Where it is missing, no plain file, too large, or not UTF-8.
    """
    check_plain(path, limits.YAML_BYTES, remedy)
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: not readable; {remedy}.") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not readable as YAML (it is not UTF-8 text); save it as UTF-8.") from error
