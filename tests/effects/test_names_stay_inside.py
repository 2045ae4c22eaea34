"""What is known of an effect stands in its file: no other room compares an effect's name."""

import ast
from functools import cache
from pathlib import Path

import wearscope
from wearscope.effects.vocabulary import list_effects

SOURCES = Path(wearscope.__file__).parent
#: Names that are words of other things as well: a kind of factor, a column, a field of a robot's drive; and
#: the rigid body, which is what a model has links by.
ELSEWHERE = {"wear", "rotor_inertia", "unknown", "rigid_body"}
#: The twin, whose planted truth shares no code with the effects.
APART = "demonstration"
#: Modules that may list names: those that write a data set's file for somebody else.
TABLES = ("starters/mapped.py", "starters/machine.py")


def compared_names(tree: ast.AST, names: set[str]) -> list[tuple[int, str]]:
    """Names that a comparison holds, with their lines."""
    return [
        (node.lineno, inner.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Compare)
        for inner in ast.walk(node)
        if isinstance(inner, ast.Constant) and inner.value in names
    ]


def listed_names(tree: ast.Module, names: set[str]) -> list[tuple[int, str]]:
    """Names of which a module's own tables hold two or more, with their lines."""
    found = []
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            held = [
                (inner.lineno, inner.value)
                for inner in ast.walk(node)
                if isinstance(inner, ast.Constant) and inner.value in names
            ]
            found += held if len({name for _, name in held}) > 1 else []
    return found


@cache
def read_sources() -> tuple[set[str], dict[Path, ast.Module]]:
    """Names of effects, and the syntax of modules outside the effects in whose text one stands, by path."""
    names = {effect.name for effect in list_effects()} - ELSEWHERE
    texts = {path.relative_to(SOURCES): path.read_text(encoding="utf-8") for path in SOURCES.rglob("*.py")}
    return names, {
        path: ast.parse(text)
        for path, text in sorted(texts.items())
        if path.parts[0] not in ("effects", APART) and any(name in text for name in names)
    }


def find_names(search, allowed=()) -> list[str]:
    """Where a search finds names, but for the modules where they are allowed."""
    names, sources = read_sources()
    return [
        f"{path}:{line}: {name}"
        for path, tree in sources.items()
        if not any(map(path.is_relative_to, allowed))
        for line, name in search(tree, names)
    ]


def test_the_search_sees_a_table():
    tree = ast.parse(
        "A = ('time_delay', 'coulomb')\nB = {'coulomb'}\ndef f():\n    x = ['viscous', 'coulomb']"
    )
    assert listed_names(tree, {"time_delay", "coulomb", "viscous"}) == [(1, "time_delay"), (1, "coulomb")]


def test_no_table_of_names_stands_outside_the_effects():
    assert find_names(listed_names, TABLES) == []


def test_the_search_sees_a_comparison():
    tree = ast.parse("if effect.name == 'time_delay' or name in ('coulomb', 'x'): pass")
    assert compared_names(tree, {"time_delay", "coulomb"}) == [(1, "time_delay"), (1, "coulomb")]


def test_no_name_is_compared_outside_the_effects():
    assert find_names(compared_names) == []
