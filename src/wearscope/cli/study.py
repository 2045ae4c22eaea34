"""Finds the study of a command: by its folder, its configuration file, or the name of a platform's study."""

import hashlib
import json
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from wearscope.cli.progress import say
from wearscope.errors import InputError, escape_text
from wearscope.home import find_home
from wearscope.robots.model_file import read_text
from wearscope.storage.files import digest_file, read_json, write_text
from wearscope.storage.plain_yaml import read_mapping

#: Values of `allow_code`, in small letters, that allow nothing.
_FALSE = ("none", "false", "no", "off", "n", "f", "0", "0.0")


@dataclass(frozen=True)
class StudyPlace:
    """Place of a study.

    Attributes
    ----------
    folder : Path
        Working directory, to which paths in the configuration refer, and which contains the results.
    config : Path
        Absolute path of the configuration.
    named : bool
        Whether the user named the study; otherwise it was found in the working directory.
    """

    folder: Path
    config: Path
    named: bool = True

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
    """Find the study that a command's argument names.

    Parameters
    ----------
    reference : str or None
        A folder with ``config/config.yaml``, a configuration file, or ``paper`` or ``quick``, which are part
        of the platform. None means the working directory. Paths in a configuration file refer to the study's
        folder where that has a Snakefile, else to the working directory.

    Raises
    ------
    InputError
        Where there is no such study.
    """
    path = Path(reference or ".")
    for own in (path / "config" / "config.yaml", path / "config.yaml"):
        if path.is_dir() and own.is_file():
            return StudyPlace(path.resolve(), own.resolve(), reference is not None)
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


#: File, relative to the working directory, that names the study that was run there last.
LAST = Path("results") / ".last-study.json"


def remember_study(place: StudyPlace) -> None:
    """Store which study was run in the working directory last."""
    if (place.folder / "results").is_dir():
        content = {"folder": str(place.folder), "config": str(place.config)}
        write_text(Path.cwd() / LAST, json.dumps(content))


def find_last_study(reference: str | None) -> StudyPlace:
    """Find a study as `find_study` does; without a reference, take the study that was run here last."""
    if reference is None and LAST.is_file():
        try:
            place = StudyPlace(**{name: Path(one) for name, one in read_json(LAST).items()}, named=False)
        except (ValueError, TypeError):
            return find_study(None)
        if place.config.is_file():
            return place
    return find_study(reference)


def find_study_or_default(reference: str | None) -> StudyPlace:
    """Return the named study, else that of the working directory, else that of the package."""
    if reference is None and not Path("config/config.yaml").is_file():
        return StudyPlace(Path.cwd(), find_home() / "config" / "config.yaml")
    return find_study(reference)


def list_code(config: Mapping[str, Any]) -> list[str]:
    """List the .py files that a configuration names, and settings that allow code; sorted, each once."""
    detectors, loop = config.get("detectors"), config.get("closed_loop")
    loop = loop if isinstance(loop, Mapping) else {}
    listed = [config.get("cycles"), loop.get("effects"), config.get("allow_code")]
    named = [one for entries in listed if isinstance(entries, list) for one in entries]
    for one in detectors.values() if isinstance(detectors, Mapping) else ():
        named.append(one.get("use") if isinstance(one, Mapping) else one)
    code = {one for one in named if isinstance(one, str) and one.endswith(".py")}
    for where, section in (("", config), ("closed_loop.", loop)):
        allowed = section.get("allow_code")
        if not isinstance(allowed, list) and str(allowed).lower() not in _FALSE:
            code.add(f"{where}allow_code: {str(allowed)[:20]}")
    return sorted(code)


def check_code_named(place: StudyPlace, config: Mapping[str, Any], allowed: bool = False) -> None:
    """Refuse a study's code that the user has not allowed to run; print which code runs.

    Parameters
    ----------
    place : StudyPlace
    config : mapping
        Settings of the study.
    allowed : bool
        Whether an option of the command allows the code.

    Raises
    ------
    InputError
        Where the code may not run.
    """
    code = list_code(config)
    if not code:
        return
    told = f"{place.config}: names code that would run ({', '.join(code)}); read it, and "
    if not place.named and not allowed:
        raise InputError(
            f"{told}name the study to let it run: 'wearscope run .', or --study . where the command is about "
            "something else."
        )
    _ask(place, code, told, allowed)
    say(InputError(f"Code that {place.config} names runs: {', '.join(code)}."), err=True)


def _ask(place: StudyPlace, code: Sequence[str], told: str, allowed: bool) -> None:
    """Ask the user whether a study's code may run.

    The answer is stored in the user's home by a digest of the code, so that unchanged code is asked about
    once.
    """
    files = [place.folder / one for one in code if one.endswith(".py")]
    digests = [digest_file(file) if file.is_file() else "" for file in files]
    asked = hashlib.sha256("\n".join([str(place.config.resolve()), *code, *digests]).encode()).hexdigest()
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    known = Path(state) / "wearscope" / "allowed.txt"
    if known.is_file() and asked in known.read_text(encoding="utf-8").split():
        return
    if not allowed and not (sys.stdin is not None and sys.stdin.isatty()):
        raise InputError(f"{told}let it run once and for all: wearscope check {place.folder} --allow-code.")
    question = f"{place.config} names code: {', '.join(code)}. Have you read it, and may it run?"
    if not allowed and not click.confirm(escape_text(question), err=True):
        raise InputError(f"{place.config}: its code may not run; take it out, or read it and allow it.")
    with suppress(OSError):
        known.parent.mkdir(parents=True, exist_ok=True)
        with known.open("a", encoding="utf-8") as file:
            print(asked, file=file)


def read_yaml(path: Path) -> dict:
    """Read a YAML file that holds a mapping.

    Raises
    ------
    InputError
        Where it does not hold one, or asks for code to be run (``__use_yte__``).
    """
    content = read_mapping(read_text(path, "a configuration, which is a YAML file"), str(path))
    if "__use_yte__" in content:
        raise InputError(f"{path}: __use_yte__ lets code in the file run; write values out and remove it.")
    return content


def read_name(path: Path, content: Mapping[str, Any] | None = None) -> str:
    """Return the name of the study in a configuration; the file is read where no content is given.

    Raises
    ------
    InputError
        Where it has no name, or one that cannot be the name of a folder.
    """
    name = (read_yaml(path) if content is None else content).get("study")
    if not isinstance(name, str) or Path(name).name != name or name in ("", ".", ".."):
        raise InputError(f"{path}: study: is missing or no name of a folder; give the study a name.")
    return name


def count_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))
