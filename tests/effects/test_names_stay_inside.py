"""What is known of an effect stands in its file: no other room compares an effect's name."""

import ast
from pathlib import Path

import wearscope
from wearscope.effects.vocabulary import list_effects

SOURCES = Path(wearscope.__file__).parent
#: Names that are words of other things as well: a kind of factor, a column, a field of a robot's drive; and
#: the rigid body, which is what a model has links by.
ELSEWHERE = {"wear", "rotor_inertia", "unknown", "rigid_body"}
#: The room that makes planted truth shares no code with the effects.
APART = "attribution_board"


def compared_names(tree: ast.AST, names: set[str]) -> list[tuple[int, str]]:
    """Names that a comparison holds, with their lines."""
    return [
        (node.lineno, inner.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Compare)
        for inner in ast.walk(node)
        if isinstance(inner, ast.Constant) and inner.value in names
    ]


def test_the_search_sees_a_comparison():
    tree = ast.parse("if effect.name == 'time_delay' or name in ('coulomb', 'x'): pass")
    assert compared_names(tree, {"time_delay", "coulomb"}) == [(1, "time_delay"), (1, "coulomb")]


def test_no_name_is_compared_outside_the_effects():
    names = {effect.name for effect in list_effects()} - ELSEWHERE
    found = [
        f"{path.relative_to(SOURCES)}:{line}: {name}"
        for path in sorted(SOURCES.rglob("*.py"))
        if path.relative_to(SOURCES).parts[0] not in ("effects", APART)
        for line, name in compared_names(ast.parse(path.read_text(encoding="utf-8")), names)
    ]
    assert found == []
