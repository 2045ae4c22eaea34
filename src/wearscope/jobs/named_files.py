"""Files on which jobs depend: those that settings and data sets name, and the sources of their scripts.

Named are robots, recordings and effects; a script's sources are found by reading its imports.
"""

import os
import re
from collections.abc import Collection, Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import yaml

from wearscope.closed_loop.intake.data_folder import find_inside, list_named
from wearscope.closed_loop.intake.dataset_fields import folder_name, load_fields
from wearscope.errors import InputError
from wearscope.plugins import installed_file
from wearscope.robots.model_file import (
    Allowed,
    check_code,
    find_model,
    list_effects,
    locate_effect,
    read_model_file,
)
from wearscope.storage.plain_yaml import take_label

PACKAGE = "wearscope"
ROOT = Path(__file__).parents[1]
#: An import of this package at the beginning of a line, indented or not. Parsing the files would take a fifth
#: of an idle run.
IMPORT = re.compile(
    rf"^\s*(?:from ({PACKAGE}[\w.]*) import (\([^)]*\)|[^\n;]+)|import ([^\n;]*\b{PACKAGE}\b[^\n;]*))",
    re.MULTILINE,
)
#: Blocks under ``if TYPE_CHECKING:`` and comments, which are no imports at run time.
LEFT_OUT = re.compile(r"^([ \t]*)if (?:\w+\.)?TYPE_CHECKING:\n(?:\1[ \t]+.*\n|\s*\n)+|#.*$", re.MULTILINE)


def find_sources(*files: str | Path) -> list[Path]:
    """Python files that running `files` may run: themselves and, transitively, the modules they import.

    Only modules of this package count; imports for type checking do not. Plug-ins are loaded by name, so
    no import shows them: name their files too (see `plugin_file`).

    Parameters
    ----------
    *files : path-like
        Python files.

    Returns
    -------
    list of Path
        Sorted, each once.

    Raises
    ------
    FileNotFoundError
        Where a file is not there.
    """
    found: set[Path] = set()
    waiting = [Path(file) for file in files]
    while waiting:
        file = waiting.pop()
        if file not in found:
            found.add(file)
            waiting.extend(_imports(file))
    return sorted(found)


def find_script_sources(script: str | Path, *plugins: str | Path) -> list[Path]:
    """Files that running a workflow script may run: also scripts next to it that it imports, and plug-ins.

    Plug-ins that are not there are left out: what loads them says which is missing.
    """
    files = [Path(script)]
    for file in files:  # the loop below appends scripts that a script imports
        imported = re.findall(r"^from (\w+) import", file.read_text(encoding="utf-8"), re.MULTILINE)
        shared = [file.with_name(f"{name}.py") for name in imported]
        files += [one for one in shared if one.is_file() and one not in files]
    return find_sources(*files, *(one for one in map(Path, plugins) if one.is_file()))


def plugin_file(reference: str, room: str) -> Path:
    """File of a plug-in given as `wearscope.plugins.load` takes it; it need not exist."""
    if reference.endswith(".py"):
        return Path(reference)
    own = ROOT / room / f"{reference}.py"
    return own if own.is_file() else installed_file(reference, room) or own


@cache
def _imports(file: Path) -> tuple[Path, ...]:
    text = LEFT_OUT.sub("", file.read_text(encoding="utf-8"))
    names: set[str] = set()
    for module, attributes, modules in IMPORT.findall(text):
        listed = [one.split()[0] for one in (attributes or modules).strip("()").split(",") if one.strip()]
        names.update(f"{module}.{one}" if module else one for one in listed)
    return tuple(Path(file) for file in {file for name in names for file in _module_files(name)})


def _module_files(name: str) -> list[str]:
    """Files that importing a dotted name runs: the packages on the way and the module itself."""
    first, *parts = name.split(".")
    if first != PACKAGE:
        return []
    folder = str(ROOT)
    files = [f"{folder}/__init__.py"]
    for part in parts:
        folder = f"{folder}/{part}"
        if os.path.isfile(f"{folder}.py"):
            return [*files, f"{folder}.py"]
        if not os.path.isfile(f"{folder}/__init__.py"):  # an attribute of the module
            break
        files.append(f"{folder}/__init__.py")
    return files


_BRACES = re.compile(r"[{}\n]")


class NamedRobot:
    """A robot's model file, with what it names.

    Parameters
    ----------
    reference : str
        As the configuration has it.
    allow_code : Allowed
        Code that models may name.

    Raises
    ------
    InputError
        Where the model cannot be read, or names code that is not allowed.
    """

    def __init__(self, reference: str, allow_code: Allowed) -> None:
        try:
            self.path = find_model(reference)
            content = read_model_file(self.path)
            self.effects = list_effects(content, str(self.path))
            check_code(self.effects, allow_code, str(self.path))
        except InputError as error:
            raise InputError(f"config: robots: {error}") from None
        self._urdf = content["urdf"]

    def list_files(self) -> list[str]:
        """Model file and URDF."""
        urdf = os.path.join(self.path.parent, self._urdf)
        if not os.path.isfile(urdf) or _BRACES.search(urdf):
            raise InputError(
                f"{self.path}: urdf: {urdf!r} is no file, or its name holds braces; name the robot's URDF."
            )
        return [str(self.path), urdf]

    def list_effect_files(self) -> list[Path]:
        """Files of the effects that the model lists."""
        return [plugin_file(locate_effect(name, self.path.parent), "effects") for name in self.effects]


class NamedDataSet:
    """A measured data set, with the files that its ``dataset.yaml`` names.

    Parameters
    ----------
    path : str
        Its folder or ``dataset.yaml``.

    Raises
    ------
    InputError
        Where there is no such file, or no name for the results' folder in it.
    """

    def __init__(self, path: str) -> None:
        self.file = os.path.join(path, "dataset.yaml") if os.path.isdir(path) else path
        try:
            _refuse_braces(self.file)
            self.content = load_fields(Path(self.file))
            self.name = folder_name(self.content.get("name"), self.file)
        except InputError as error:
            raise InputError(f"config: dataset: {error}") from None

    @cached_property
    def files(self) -> list[str]:
        """URDF, runs and own effects that are there; the loop says which is missing."""
        return self._list_files(self.content)

    @property
    def effects(self) -> list[str]:
        """Names of effects that the data set asks for."""
        listed = [self.content.get(field) for field in ("effects", "declared_effects")]
        return [
            name for names in listed if isinstance(names, list) for name in names if isinstance(name, str)
        ]

    def take_session_fields(self, sessions: Collection[str]) -> str:
        """Fields of ``dataset.yaml`` that the runs of some sessions depend on, as YAML."""
        return yaml.safe_dump(self._take_sessions(sessions))

    def list_session_files(self, sessions: Collection[str]) -> list[str]:
        """As `files`, of the runs of some sessions."""
        return self._list_files(self._take_sessions(sessions))

    def _take_sessions(self, sessions: Collection[str]) -> dict[str, Any]:
        content = {key: value for key, value in self.content.items() if key not in ("reference", "runs")}
        listed = self.content.get("runs")
        runs = [run for run in listed if isinstance(run, dict)] if isinstance(listed, list) else []
        own = [run for run in runs if str(take_label(run.get("session"))) in sessions]
        return {**content, "runs": own}

    def _list_files(self, content: Mapping[str, Any]) -> list[str]:
        folder, found = Path(self.file).parent, []
        for name in list_named(content):
            try:
                path = find_inside(folder, name, "dataset.yaml")
            except InputError:
                continue
            if path.is_file():
                found.append(str(path))
        for file in found:
            try:
                _refuse_braces(file)
            except InputError as error:
                raise InputError(f"config: dataset: {error}") from None
        return found


def _refuse_braces(file: str) -> None:
    """Refuse a path that Snakemake would read as a pattern."""
    if _BRACES.search(file):
        raise InputError(f"{file}: the path holds a brace or the end of a line; rename that file or folder.")
