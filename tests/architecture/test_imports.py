"""The rooms' rules of docs/architecture.md, held against every import of the source."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "wearscope"


def read_rules():
    """Rooms that each room may import, by the table of docs/architecture.md; some are for all."""
    text = (ROOT / "docs" / "architecture.md").read_text()
    rows = re.findall(r"^\| `([a-z_]+(?:/[a-z_]+)?)/`( itself)? \|.*\| (.*?) ?\|$", text, re.MULTILINE)
    told = {name: words for name, _, words in rows}
    rooms = set(told)
    rules = {}
    for name, words in told.items():
        named = {
            room if (room := word.rstrip("/")) in rooms else f"{name.split('/')[0]}/{room}"
            for word in re.findall(r"[a-z_]+(?:/[a-z_]+)?", words)
        } & rooms
        rules[name] = rooms - named if words.startswith("all but") else rooms if words == "all" else named
    used_by_all = {name for name, words in told.items() if words.endswith("all may import it")}
    return {name: allowed | used_by_all for name, allowed in rules.items()}


RULES = read_rules()


def room_of(parts):
    """Room of a module given by its dotted parts; empty for a module at the top."""
    for room in ("/".join(parts[:2]), "/".join(parts[:1])):
        if room in RULES:
            return room
    return ""


def imports_of(text, types=False):
    """Dotted names that a module imports, within functions too; those for type checking if `types`."""
    tree = ast.parse(text)
    guards = [
        node for node in ast.walk(tree) if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
    ]
    types_only = {inner for guard in guards for part in guard.body for inner in ast.walk(part)}
    for node in ast.walk(tree):
        if node in types_only and not types:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "a relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def breaches(room, text):
    """Rooms that a module of a room imports against the rules."""
    found = set()
    for name in imports_of(text):
        first, *parts = name.split(".")
        other = room_of(parts) if first == "wearscope" else ""
        allowed = RULES[room] | {room}
        own_floor = other.startswith(f"{room}/")
        above = "" if room.split("/")[0] == other.split("/")[0] else other.split("/")[0]
        if other and other not in allowed and above not in allowed and not own_floor:
            found.add(other)
    return found


def circles(imports):
    """Modules that reach themselves by imports, of a mapping from module to what it imports."""
    names = list(imports)
    place = {name: k for k, name in enumerate(names)}
    graph = np.zeros((len(names), len(names)))
    for name, found in imports.items():
        for one in found:
            # A name within a module, or the module itself.
            target = next((x for x in (one, one.rpartition(".")[0]) if x in place), name)
            graph[place[name], place[target]] = target != name
    _, label = connected_components(graph, connection="strong")
    return {name for name, size in zip(names, np.bincount(label)[label], strict=True) if size > 1}


def read_imports():
    """Dotted names that every module of the source imports, for type checking too."""
    found = {}
    for path in SOURCE.rglob("*.py"):
        parts = path.relative_to(SOURCE.parent).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = set(imports_of(path.read_text(), types=True))
    return found


def test_no_modules_import_each_other_in_a_circle():
    assert circles(read_imports()) == set()


def test_a_circle_would_be_found():
    assert circles({"a": {"b.f"}, "b": {"c"}, "c": {"a"}, "d": {"a", "os"}}) == {"a", "b", "c"}
    text = "if TYPE_CHECKING:\n    from wearscope.storage.files import write_whole"
    assert list(imports_of(text, types=True)) == ["wearscope.storage.files.write_whole"]


@pytest.mark.parametrize("room", sorted(RULES))
def test_a_room_imports_what_it_may(room):
    files = [path for path in (SOURCE / room).rglob("*.py") if _room(path) == room]
    assert files
    found = {path.relative_to(SOURCE).as_posix(): breaches(room, path.read_text()) for path in files}
    assert {name: rooms for name, rooms in found.items() if rooms} == {}


def _room(path):
    return room_of(path.relative_to(SOURCE).with_suffix("").parts)


def test_every_room_has_its_row():
    packages = {path.parent.name for path in SOURCE.glob("*/__init__.py")}
    assert packages == {room for room in RULES if "/" not in room}


def test_a_breach_would_be_found():
    assert breaches("effects", "from wearscope.reporting.style import save_figure") == {"reporting"}
    assert breaches("surrogates", "def f():\n    import wearscope.simulation.run") == {"simulation"}
    assert breaches("closed_loop/intake", "from wearscope.closed_loop.inference.score import X") == {
        "closed_loop/inference"
    }
    assert breaches("simulation", "from wearscope.effects.base import Plant") == set()


def test_what_all_rooms_use_imports_none_of_them():
    names = ("errors", "limits", "home", "plugins", "processes", "supervision")
    for path in [*(SOURCE / f"{name}.py" for name in names), *(SOURCE / "storage").glob("*.py")]:
        found = {one for one in imports_of(path.read_text()) if one.startswith("wearscope.")}
        assert {room_of(one.split(".")[1:]) for one in found} <= {"", "storage"}, path


def test_the_source_does_not_import_snakemake():
    for path in SOURCE.rglob("*.py"):
        assert not any(name.split(".")[0] == "snakemake" for name in imports_of(path.read_text())), path


def test_the_generators_share_no_code_with_the_effects():
    for path in [*(SOURCE / "demonstration").glob("*.py"), *(ROOT / "benchmarks" / "board").glob("*.py")]:
        found = {name for name in imports_of(path.read_text()) if name.startswith("wearscope.effects")}
        assert found == set(), path


def test_every_package_that_the_platform_is_asked_to_use_is_used():
    """Snakemake runs the source, which does not import it."""
    found = {name.split(".")[0] for path in SOURCE.rglob("*.py") for name in imports_of(path.read_text())}
    assert {"pybullet", "numpy", "scipy", "statsmodels", "pandas", "pyarrow", "seaborn"} <= found
