"""Finds a plug-in (effect, detector, test-cycle or robot) by its name, or by the path of a Python file.

A room is a kind of plug-in, and the folder of the package that holds the built-in ones, such as
``detectors``. An installed package can offer plug-ins by the entry point ``wearscope.<room>``; it is imported
only when one of them is used.
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

#: Attribute, in a module loaded from a user's file, with the SHA-256 of the file's content.
_DIGEST = "__wearscope_digest__"
#: Prefix of such a module's name in `sys.modules`.
_PREFIX = "wearscope_user_"
#: Suffixes of the files that determine what a package's plug-ins do.
_SOURCES = (".py", ".yaml", ".yml", ".urdf")


def list_names(room: str, attribute: str) -> list[str]:
    """List the built-in plug-ins: modules of `wearscope.<room>` that define `attribute`, sorted.

    The room's other modules, such as ``base``, do not define it.
    """
    package = importlib.import_module(f"wearscope.{room}")
    names = sorted(
        module.name
        for module in pkgutil.iter_modules(package.__path__)
        if not module.name.startswith("_") and not module.ispkg
    )
    return [name for name in names if hasattr(importlib.import_module(f"wearscope.{room}.{name}"), attribute)]


def list_installed(room: str) -> list[str]:
    """List the names of plug-ins that installed packages offer for a room, sorted, without importing them."""
    return sorted({point.name for point in entry_points(group=f"wearscope.{room}")})


def find_installed(name: str, room: str) -> EntryPoint | None:
    """Return the entry point of a plug-in that an installed package offers; None if no package does.

    Raises
    ------
    InputError
        If packages offer different plug-ins under this name.
    """
    points = {point.value: point for point in entry_points(group=f"wearscope.{room}", name=name)}
    if len(points) > 1:
        owners = ", ".join(sorted(point.dist.name for point in points.values() if point.dist is not None))
        raise InputError(f"{room}: '{name}' is offered by several packages ({owners}); remove all but one.")
    return next(iter(points.values()), None)


def installed_file(name: str, room: str) -> Path | None:
    """Return the file of an installed plug-in's module; None if no package offers it.

    The packages that contain the module are imported, the module itself is not.

    Raises
    ------
    InputError
        If the module does not exist, or is not loaded from a file.
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
    """Return package, version and digest of an installed plug-in as text; None if no package offers it.

    The digest covers the Python, YAML and URDF files of the module's top package. So it shows a change even
    if dates and version stay the same.

    Raises
    ------
    InputError
        If the plug-in's module is not found, see `installed_file`.
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
    """Import the module of an installed plug-in."""
    try:
        return importlib.import_module(point.module)
    except (Exception, SystemExit) as error:
        raise InputError(_tell_broken(point, room, error)) from error


def _tell_broken(point: EntryPoint, room: str, error: BaseException) -> str:
    """Return the message for an installed plug-in that cannot be imported."""
    owner = "" if point.dist is None else f" of package {point.dist.name}"
    told = f"importing '{point.name}'{owner} raised {tell_error(error)}"
    return f"{room}: {told}; correct the package, or remove it."


def load_file(path: Path, attribute: str) -> ModuleType:
    """Import a Python file and return its module; it is imported again only if its content has changed.

    The module gets a name in `sys.modules` that depends on the file's path only. So it is the same in every
    process, which functions need that Numba caches on disk: they find their module by its name.

    Parameters
    ----------
    path : Path
    attribute : str
        Name that the file must define, for messages.

    Raises
    ------
    InputError
        If there is no such file, or it cannot be imported.
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
        # Numba's cache next to the file names the module by the path from which the file was moved.
        for kept in place.parent.glob(f"__pycache__/{place.stem}.*.nb[ci]"):
            kept.unlink(missing_ok=True)
        try:
            return _execute(name, place, digest)
        except (Exception, SystemExit) as error:
            failure = error
    raise InputError(f"{path}: importing it raised {tell_error(failure)}; correct the file.") from failure


def _execute(name: str, place: Path, digest: str) -> ModuleType:
    """Run a Python file as the module `name` and return it; if that fails, remove it from `sys.modules`."""
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
        Name of a built-in plug-in, that is, of a module of `wearscope.<room>`; else name of a plug-in of an
        installed package; or path of a ``.py`` file.
    room, attribute : str
        Kind of plug-in, and name that its module defines, e.g. ``"detectors"`` and ``"DETECTOR"``.

    Raises
    ------
    InputError
        If there is no such plug-in, it cannot be imported, or its module does not define `attribute`.
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
    """Return whether a room has a built-in module of this name."""
    return name.isidentifier() and importlib.util.find_spec(f"wearscope.{room}.{name}") is not None
