"""Finds an effect, a detector or a test-cycle by its name in its room, or by the path of a Python file."""

import importlib
import importlib.util
import pkgutil
from pathlib import Path
from typing import Any

from wearscope.errors import InputError


def list_names(room: str, attribute: str) -> list[str]:
    """Names of the modules of `wearscope.<room>` that define `attribute`, sorted.

    A module whose name is that of the room's machinery (``base``, ``registry``) or starts with an
    underscore holds no plug-in.
    """
    package = importlib.import_module(f"wearscope.{room}")
    names = sorted(
        module.name
        for module in pkgutil.iter_modules(package.__path__)
        if not module.name.startswith("_") and not module.ispkg
    )
    return [name for name in names if hasattr(importlib.import_module(f"wearscope.{room}.{name}"), attribute)]


def load(reference: str, room: str, attribute: str) -> Any:
    """Load a plug-in.

    Parameters
    ----------
    reference : str
        The name of a module of `wearscope.<room>`, or the path of a ``.py`` file.
    room, attribute : str
        E.g. ``"detectors"``, ``"DETECTOR"``.

    Raises
    ------
    InputError
        Where there is no such module or file, it cannot be imported, or it does not define `attribute`.
    """
    if reference.endswith(".py"):
        path = Path(reference)
        if not path.is_file():
            raise InputError(f"{reference}: no such file; name a Python file that defines {attribute}.")
        spec = importlib.util.spec_from_file_location(f"wearscope_user_{path.stem}", path)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        try:
            spec.loader.exec_module(module)
        except (Exception, SystemExit) as error:
            raise InputError(
                f"{reference}: importing it raised {type(error).__name__}: {error}; mend the file."
            ) from error
    else:
        if not reference.isidentifier() or importlib.util.find_spec(f"wearscope.{room}.{reference}") is None:
            known = ", ".join(list_names(room, attribute))
            raise InputError(
                f"{room}: there is no '{reference}'; choose one of {known}, or the path of a .py file."
            )
        module = importlib.import_module(f"wearscope.{room}.{reference}")
    if not hasattr(module, attribute):
        raise InputError(f"{reference}: defines no {attribute}; add a module-level {attribute}.")
    return getattr(module, attribute)
