"""Finds an effect, a detector or a test-cycle by its name in its room, or by the path of a Python file.

A name may also be that of a plug-in of an installed package, by the entry point ``wearscope.<room>``; nothing
of the package is imported before somebody names it.
"""

import hashlib
import importlib
import importlib.util
import pkgutil
import re
import sys
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from wearscope import limits
from wearscope.errors import InputError, tell_error
from wearscope.storage.files import check_plain

#: Where a module that was loaded from a file keeps the digest of the file's content.
_DIGEST = "__wearscope_digest__"
#: Start of such a module's name.
_PREFIX = "wearscope_user_"
#: What a package's plug-ins are made of: code, models, robots.
_SOURCES = (".py", ".yaml", ".yml", ".urdf")


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


def list_installed(room: str) -> list[str]:
    """Names that installed packages offer for a room, sorted; none of them is imported."""
    return sorted({point.name for point in entry_points(group=f"wearscope.{room}")})


def find_installed(name: str, room: str) -> EntryPoint | None:
    """Object that an installed package offers for a room under a name; None where no package does.

    Raises
    ------
    InputError
        Where two packages offer different things under the name.
    """
    points = {point.value: point for point in entry_points(group=f"wearscope.{room}", name=name)}
    if len(points) > 1:
        owners = ", ".join(sorted(point.dist.name for point in points.values() if point.dist is not None))
        raise InputError(f"{room}: '{name}' is offered by several packages ({owners}); remove all but one.")
    return next(iter(points.values()), None)


def installed_file(name: str, room: str) -> Path | None:
    """File of the module that `find_installed` names; only the packages that it lies in are imported.

    Raises
    ------
    InputError
        Where there is no such module, or it is no file.
    """
    point = find_installed(name, room)
    if point is None:
        return None
    try:
        spec = importlib.util.find_spec(point.module)
    except (Exception, SystemExit) as error:
        raise InputError(_tell_broken(point, room, error)) from error
    if spec is None or spec.origin is None:
        raise InputError(_tell_broken(point, room, ModuleNotFoundError(f"no module file {point.module}")))
    return Path(spec.origin)


def identify_installed(name: str, room: str) -> str | None:
    """Package, version and digest of an installed plug-in of a room; None where no package offers it.

    The digest covers the Python, YAML and URDF files of the module's package, so that changed content is seen
    even if dates and version stay.

    Raises
    ------
    InputError
        As `installed_file`.
    """
    point, file = find_installed(name, room), installed_file(name, room)
    if point is None or file is None:
        return None
    folder = file.parent
    while (folder / "__init__.py").is_file() and (folder.parent / "__init__.py").is_file():
        folder = folder.parent
    files = [file]
    if (folder / "__init__.py").is_file():
        files = sorted(one for one in folder.rglob("*") if one.suffix in _SOURCES and one.is_file())
    digest = hashlib.sha256()
    for one in files:
        digest.update(f"{one.relative_to(folder).as_posix()}\0".encode())
        digest.update(hashlib.sha256(one.read_bytes()).digest())
    owner = "a package" if point.dist is None else f"{point.dist.name} {point.dist.version}"
    return f"{owner}, sha256 {digest.hexdigest()}"


@cache
def _import_installed(point: EntryPoint, room: str) -> ModuleType:
    try:
        return importlib.import_module(point.module)
    except (Exception, SystemExit) as error:
        raise InputError(_tell_broken(point, room, error)) from error


def _tell_broken(point: EntryPoint, room: str, error: BaseException) -> str:
    owner = "" if point.dist is None else f" of package {point.dist.name}"
    told = f"importing '{point.name}'{owner} raised {tell_error(error)}"
    return f"{room}: {told}; correct the package, or remove it."


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
    check_plain(path, limits.TEXT_BYTES, f"name a Python file that defines {attribute}")
    try:
        place = path.resolve(strict=True)
        content = place.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); make it readable.") from None
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
        # Compiled functions kept next to the file before it was moved here.
        for kept in place.parent.glob(f"__pycache__/{place.stem}.*.nb[ci]"):
            kept.unlink(missing_ok=True)
        try:
            return _execute(name, place, digest)
        except (Exception, SystemExit) as error:
            failure = error
    raise InputError(f"{path}: importing it raised {tell_error(failure)}; correct the file.") from failure


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
        The name of a module of `wearscope.<room>`, or else of a plug-in of an installed package, or the path
        of a ``.py`` file.
    room, attribute : str
        E.g. ``"detectors"``, ``"DETECTOR"``.

    Raises
    ------
    InputError
        Where there is no such module or file, it cannot be imported, or it does not define `attribute`.
    """
    if reference.endswith(".py"):
        module = load_file(Path(reference), attribute)
    elif is_built_in(reference, room):
        module = importlib.import_module(f"wearscope.{room}.{reference}")
    else:
        point = find_installed(reference, room)
        if point is None:
            known = ", ".join([*list_names(room, attribute), *list_installed(room)])
            raise InputError(
                f"{room}: there is no '{reference}'; choose one of {known}, or the path of a .py file."
            )
        module, attribute = _import_installed(point, room), point.attr or attribute
    if not hasattr(module, attribute):
        raise InputError(f"{reference}: defines no {attribute}; add a module-level {attribute}.")
    return getattr(module, attribute)


def is_built_in(name: str, room: str) -> bool:
    """Whether a room has a module of this name."""
    return name.isidentifier() and importlib.util.find_spec(f"wearscope.{room}.{name}") is not None
