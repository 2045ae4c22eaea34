"""The page on the closed loop states the rule's numbers as the code has them."""

import re
from pathlib import Path

from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.policy import Policy

PAGE = Path(__file__).parents[2] / "docs" / "closed-loop.md"


def stated_numbers() -> dict[str, float]:
    rows = re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    return {name: float(value) for name, value in rows}


def test_numbers_that_can_be_set():
    stated = {name: value for name, value in stated_numbers().items() if not name.startswith("_")}
    assert stated == Policy().model_dump()


def test_numbers_that_cannot_be_set():
    stated = {name: value for name, value in stated_numbers().items() if name.startswith("_")}
    assert stated == {name: value for name, value in vars(rule).items() if re.fullmatch(r"_[A-Z_]+", name)}
