"""Files that a configuration and a data set name, on which jobs depend: robots, recordings, effects."""

import os
import re
from collections.abc import Collection, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml

from wearscope.closed_loop.intake.data_folder import find_inside, list_named
from wearscope.closed_loop.intake.dataset_fields import folder_name, load_fields
from wearscope.errors import InputError
from wearscope.jobs.sources import plugin_file
from wearscope.robots.model_file import (
    Allowed,
    check_code,
    find_model,
    list_effects,
    locate_effect,
    read_model_file,
)
from wearscope.storage.plain_yaml import take_label

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
        """What of ``dataset.yaml`` the runs of some sessions depend on, as YAML."""
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
