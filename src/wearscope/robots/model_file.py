"""Finds and reads model files as plain fields, without the URDF, and handles the effect files they name."""

import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from wearscope import limits, plugins
from wearscope.errors import InputError
from wearscope.home import find_home
from wearscope.storage.files import check_plain
from wearscope.storage.plain_yaml import read_mapping

DEFAULT_ROBOTS_DIR = Path("config/robots")

#: Which effects may be .py files: True for all, False for none, or a list.
Allowed = bool | list[str] | tuple[str, ...]


def find_model(reference: str | Path, robots_dir: str | Path | None = None) -> Path:
    """Find the path of a model file from the reference that `wearscope.robots.model.load_model` takes.

    Raises
    ------
    InputError
        Where there is no such file.
    """
    folders = (
        [DEFAULT_ROBOTS_DIR, find_home() / DEFAULT_ROBOTS_DIR] if robots_dir is None else [Path(robots_dir)]
    )
    path = Path(reference)
    for candidate in (path, path / "model.yaml", *(folder / path / "model.yaml" for folder in folders)):
        try:
            if candidate.is_file():
                return candidate
        except (ValueError, OSError):  # an impossible path, or a name that is too long
            break
    module = plugins.installed_file(str(reference), "robots") if isinstance(reference, str) else None
    if module is not None:
        if (module.parent / "model.yaml").is_file():
            return module.parent / "model.yaml"
        raise InputError(f"robot '{reference}': {module.parent} holds no model.yaml; add it to the package.")
    there = {file.parent.name for folder in folders for file in folder.glob("*/model.yaml")}
    known = ", ".join(sorted({*there, *plugins.list_installed("robots")})) or "none"
    raise InputError(
        f"robot {str(reference)!r}: no such model file, nor folder with a model.yaml, nor robot in "
        f"{folders[0]} (there: {known}); correct the name."
    )


def read_text(path: str | Path, what: str) -> str:
    """Read a text file that may come from someone else; `what` names the expected file in messages.

    Raises
    ------
    InputError
        Where it is not a plain file, too large, or not UTF-8 text.
    """
    path = Path(path)
    check_plain(path, limits.TEXT_BYTES, f"name {what}")
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); name {what}.") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not a text file in UTF-8; save it as UTF-8, or name {what}.") from error


def read_model_file(path: Path) -> dict[str, Any]:
    """Read the content of a model file.

    Raises
    ------
    InputError
        Where it cannot be read, is no mapping, names no URDF, or lists its effects in a wrong form.
    """
    if path.suffix.lower() == ".urdf":
        raise InputError(f"{path}: is a URDF; make a robot of it first: wearscope new robot {path}.")
    fields = read_mapping(read_text(path, "the robot's model file"), str(path))
    if not all(isinstance(key, str) for key in fields):
        raise InputError(f"{path}: a key is no text; write the model's fields as 'key: value'.")
    if not isinstance(fields.get("urdf"), str):
        raise InputError(f"{path}: urdf: is missing or no text; name the URDF next to the model file.")
    list_effects(fields, str(path))
    return fields


def list_effects(fields: Mapping[str, Any], where: str) -> list[str]:
    """List the names of the effects in a model file, each once, sorted.

    Raises
    ------
    InputError
        Where `effects` is not a list of mappings with a joint and an effect.
    """
    entries = fields.get("effects", [])
    if not isinstance(entries, list):
        raise InputError(f"{where}: effects: is no list; write an entry '- joint: ...' for each effect.")
    for k, entry in enumerate(entries):
        for key in ("joint", "effect"):
            if not isinstance(entry, dict) or not isinstance(entry.get(key), str):
                raise InputError(f"{where}: effects[{k}].{key}: is missing or no text; add it.")
    return sorted({entry["effect"] for entry in entries})


def locate_effect(effect: str, folder: Path) -> str:
    """Return an effect of a model file in `folder` by its name, or by the absolute path of its .py file."""
    return os.path.abspath(folder / effect) if effect.endswith(".py") else effect


def locate_effects(fields: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the content of a model file in `folder` with absolute paths of effect files."""
    entries = [
        {**entry, "effect": locate_effect(entry["effect"], folder)} for entry in fields.get("effects", [])
    ]
    return {**fields, "effects": entries} if entries else dict(fields)


def relate_effects(fields: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Reverse `locate_effects`: make effect files relative to `folder`, so that all can be moved together."""
    entries = [
        {**entry, "effect": os.path.relpath(entry["effect"], folder)}
        if entry["effect"].endswith(".py")
        else entry
        for entry in fields.get("effects", [])
    ]
    return {**fields, "effects": entries} if entries else dict(fields)


def _is_among(effect: str, allowed: Collection[str], where: str) -> bool:
    """Return whether an effect's file is allowed, by the path in the model or any path to the same file."""
    file = (Path(where).parent / effect).resolve()
    return effect in allowed or file in {Path(path).resolve() for path in allowed}


def check_code(effects: list[str], allowed: Allowed, where: str) -> None:
    """Refuse effects that are .py files which the user has not allowed.

    Raises
    ------
    InputError
        Names the file, and how to allow it.
    """
    for effect in effects:
        named = allowed is True or (not isinstance(allowed, bool) and _is_among(effect, allowed, where))
        if effect.endswith(".py") and not named:
            raise InputError(
                f"{where}: the effect {effect!r} is code that would run; read it, and allow it in the "
                f"study's configuration with allow_code: [{effect}], or take the effect out of the model."
            )
