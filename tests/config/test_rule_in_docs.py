"""The page on the closed loop states the rule's numbers as the code has them."""

import re
from pathlib import Path

from wearscope.closed_loop.intake.thinning import Budget
from wearscope.closed_loop.selection import generic, rule
from wearscope.closed_loop.selection.policy import Policy

PAGE = Path(__file__).parents[2] / "docs" / "closed-loop.md"


def stated_numbers() -> dict[str, float]:
    rows = re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    return {name: float(value) for name, value in rows}


def test_numbers_of_the_rule():
    assert stated_numbers() == Policy().model_dump()


def test_the_rule_has_no_numbers_of_its_own():
    assert not [name for name in vars(rule) if re.fullmatch(r"_?[A-Z_]+", name)]


def test_how_much_of_the_runs_is_used():
    text = PAGE.read_text(encoding="utf-8")
    found = re.findall(r"^\| `(joint_\w+)`[^|]*\| ([\d,]+)", text, re.MULTILINE)
    stated = {name: float(value.replace(",", "")) for name, value in found}
    budget = Budget()
    names = ("joint_seconds", "joint_samples", "joint_rows")
    assert stated == {name: getattr(budget, name) for name in names}
    shares = re.findall(r"^\| `joint_seconds`.*\| (\d+) % \|$", text, re.MULTILINE)
    assert shares == [f"{100 * budget.tested:.0f}"]
    assert f"stretches of about {budget.stretch:.0f} s" in " ".join(text.split())
    assert f"({generic._ROOM >> 20} MiB)" in text
