"""Which study a command is about: a folder, a configuration file, or the name of one that comes along."""

import json
import os
from dataclasses import dataclass
from pathlib import Path

import yaml

from wearscope import tables
from wearscope.errors import InputError, explain_yaml
from wearscope.home import find_home
from wearscope.plain_yaml import load_plain_yaml
from wearscope.robots.model_file import read_text


@dataclass(frozen=True)
class StudyPlace:
    """Where a study is.

    Attributes
    ----------
    folder : Path
        Working directory: paths in the configuration, and results, are from here.
    config : Path
        The configuration, absolute.
    """

    folder: Path
    config: Path

    @property
    def results(self) -> Path:
        """Folder of the study's results.

        Raises
        ------
        InputError
            Where the configuration cannot be read or has no name.
        """
        return self.folder / "results" / read_name(self.config)


def find_study(reference: str | None) -> StudyPlace:
    """Study given as a command takes it.

    Parameters
    ----------
    reference : str or None
        A folder with ``config/config.yaml``, a configuration file (its paths are from the working
        directory), or ``paper`` or ``quick``, which come along; the working directory where None.

    Raises
    ------
    InputError
        Where there is none.
    """
    path = Path(reference or ".")
    for own in (path / "config" / "config.yaml", path / "config.yaml"):
        if path.is_dir() and own.is_file():
            return StudyPlace(path.resolve(), own.resolve())
    if path.is_file():
        file = path.resolve()
        folder = file.parent.parent if file.parent.name == "config" else file.parent
        inside = (folder / "Snakefile").is_file() and folder != find_home()
        return StudyPlace(folder if inside else Path.cwd(), file)
    carried = {"paper": "config.yaml", "quick": "quick.yaml"}
    if reference in carried:
        return StudyPlace(Path.cwd(), find_home() / "config" / carried[reference])
    where = f"{path}: is no study's folder or configuration" if reference else "no config/config.yaml is here"
    raise InputError(f"{where}; make one with 'wearscope new study NAME', or name 'quick' or 'paper'.")


#: Where a folder keeps which study was run in it last.
LAST = Path("results") / ".last-study.json"


def remember_study(place: StudyPlace) -> None:
    """Keep which study was run in the working directory last."""
    if (place.folder / "results").is_dir():
        content = {"folder": str(place.folder), "config": str(place.config)}
        tables.write_text(Path.cwd() / LAST, json.dumps(content))


def find_last_study(reference: str | None) -> StudyPlace:
    """As `find_study`; without a reference the study that was run here last, where there was one."""
    if reference is None and LAST.is_file():
        try:
            place = StudyPlace(**{name: Path(one) for name, one in json.loads(LAST.read_text()).items()})
        except (ValueError, TypeError, AttributeError):
            return find_study(None)
        if place.config.is_file():
            return place
    return find_study(reference)


def read_yaml(path: Path) -> dict:
    """Content of a YAML file that holds a mapping.

    Raises
    ------
    InputError
        Where it is none.
    """
    try:
        content = load_plain_yaml(read_text(path, "a configuration, which is a YAML file"))
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: is not readable YAML ({explain_yaml(error)}); correct it.") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds no settings; write them as 'name: value'.")
    return content


def read_name(path: Path) -> str:
    """Name of the study that a configuration describes.

    Raises
    ------
    InputError
        Where it has none that makes a folder.
    """
    name = read_yaml(path).get("study")
    if not isinstance(name, str) or Path(name).name != name or name in ("", ".", ".."):
        raise InputError(f"{path}: study: is missing or no name of a folder; give the study a name.")
    return name


def count_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0))
