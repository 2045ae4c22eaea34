"""Which source files a script's result depends on, found by reading its imports."""

import os
import re
from functools import cache
from pathlib import Path

from wearscope.plugins import installed_file

PACKAGE = "wearscope"
ROOT = Path(__file__).parents[1]
#: An import of this package, wherever a line may begin. To parse the files would take a fifth of an idle run.
IMPORT = re.compile(
    rf"^\s*(?:from ({PACKAGE}[\w.]*) import (\([^)]*\)|[^\n;]+)|import ([^\n;]*\b{PACKAGE}\b[^\n;]*))",
    re.MULTILINE,
)
#: What is imported for type checking alone, the lines that are indented further than its condition; comments.
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
    for file in files:  # which grows by the scripts that a script imports
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
