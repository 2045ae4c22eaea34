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
def read_sources() -> dict[Path, ast.Module]:
    """Syntax of every module outside the effects, by its path in the source."""
    found = {path.relative_to(SOURCES): path for path in sorted(SOURCES.rglob("*.py"))}
    return {
        name: ast.parse(path.read_text(encoding="utf-8"))
        for name, path in found.items()
        if name.parts[0] not in ("effects", APART)
    }


def test_the_search_sees_a_table():
    tree = ast.parse(
        "A = ('time_delay', 'coulomb')\nB = {'coulomb'}\ndef f():\n    x = ['viscous', 'coulomb']"
    )
    assert listed_names(tree, {"time_delay", "coulomb", "viscous"}) == [(1, "time_delay"), (1, "coulomb")]


def test_no_table_of_names_stands_outside_the_effects():
    names = {effect.name for effect in list_effects()} - ELSEWHERE
    found = [
        f"{path}:{line}: {name}"
        for path, tree in read_sources().items()
        if not any(map(path.is_relative_to, TABLES))
        for line, name in listed_names(tree, names)
    ]
    assert found == []


def test_the_search_sees_a_comparison():
    tree = ast.parse("if effect.name == 'time_delay' or name in ('coulomb', 'x'): pass")
    assert compared_names(tree, {"time_delay", "coulomb"}) == [(1, "time_delay"), (1, "coulomb")]


def test_no_name_is_compared_outside_the_effects():
    names = {effect.name for effect in list_effects()} - ELSEWHERE
    found = [
        f"{path}:{line}: {name}"
        for path, tree in read_sources().items()
        for line, name in compared_names(tree, names)
    ]
    assert found == []
