"""The documentation's tables of the rule and of the budget state the numbers of the code."""

import re
import sys
from pathlib import Path

import pytest

from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.intake.thinning import Budget

sys.path.insert(0, str(Path(__file__).parents[2] / "docs" / "site"))
import measured


def test_numbers_of_the_rule():
    rows = re.findall(r"^\| `(\w+)` \| ([\d.]+) \| \S", measured.policy_table(), re.MULTILINE)
    assert {name: float(value) for name, value in rows} == Policy().model_dump()


def test_how_much_of_the_runs_is_used():
    text = measured.fill_places("[[table: budget]] [[value: stretch]]")
    found = re.findall(r"^\| `(joint_\w+)`[^|]*\| ([\d,]+)", text, re.MULTILINE)
    stated = {name: float(value.replace(",", "")) for name, value in found}
    budget = Budget()
    assert stated == {
        name: getattr(budget, name) for name in ("joint_seconds", "joint_samples", "joint_rows")
    }
    assert f"-->{budget.stretch:g}<!--" in text


def test_a_table_that_is_not_there_is_an_error():
    with pytest.raises(KeyError, match="nothing_like_it"):
        measured.fill_places("[[table: nothing_like_it]]")
