"""Finds an effect, a detector or a test-cycle by its name in its room, or by the path of a Python file."""

import hashlib
import importlib
import importlib.util
import pkgutil
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from wearscope.errors import InputError

#: Where a module that was loaded from a file keeps the digest of the file's content.
_DIGEST = "__wearscope_digest__"
#: Start of such a module's name.
_PREFIX = "wearscope_user_"


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


def load_file(path: Path, attribute: str) -> ModuleType:
    """Module of a Python file, imported once as long as its content stays.

    It is known to `sys.modules` under a name of its own, the same in every process: compiled functions that
    are kept on disk (`numba.njit(cache=True)`) look their module up by its name.

    Parameters
    ----------
    path : Path
    attribute : str
        What the file must define; for messages.

    Raises
    ------
    InputError
        Where there is no such file, or it cannot be imported.
    """
    try:
        place = path.resolve(strict=True)
        content = place.read_bytes()
    except OSError:
        raise InputError(f"{path}: no such file; name a Python file that defines {attribute}.") from None
    digest = hashlib.sha256(content).hexdigest()
    where = hashlib.sha256(str(place).encode()).hexdigest()[:12]
    name = f"{_PREFIX}{re.sub(r'[^0-9A-Za-z_]', '_', place.stem)}_{where}"
    known = sys.modules.get(name)
    if known is not None and known.__dict__.get(_DIGEST) == digest:
        return known
    try:
        return _execute(name, place, digest)
    except (Exception, SystemExit) as error:
        failure = error
    if isinstance(failure, ModuleNotFoundError) and str(failure.name).startswith((_PREFIX, "<dynamic>")):
        # Compiled functions kept beside the file before it was moved here.
        for kept in place.parent.glob(f"__pycache__/{place.stem}.*.nb[ci]"):
            kept.unlink(missing_ok=True)
        try:
            return _execute(name, place, digest)
        except (Exception, SystemExit) as error:
            failure = error
    told = " ".join(str(failure).split())
    raise InputError(
        f"{path}: importing it raised {type(failure).__name__}: {told}; correct the file."
    ) from failure


def _execute(name: str, place: Path, digest: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, place)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    module.__dict__[_DIGEST] = digest
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


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
        module = load_file(Path(reference), attribute)
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
