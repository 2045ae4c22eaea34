"""Tables of pages, after ``<!-- table: NAME -->``: measured ones from a file, numbers from the code."""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.intake.thinning import Budget

FILE = Path(__file__).with_name("measured.yaml")
#: A place that nothing was written into yet.
_NEW = re.compile(r"\[\[(table|value): (\w+)\]\]")
_PLACE = re.compile(r"(<!-- (table|value): (\w+) -->).*?(<!-- end -->)", re.DOTALL)


@cache
def read_measured() -> dict[str, Any]:
    """Measured tables by name, read once for all pages."""
    return yaml.safe_load(FILE.read_text(encoding="utf-8"))


def fill_places(text: str) -> str:
    """A page's text with its tables and values.

    Raises
    ------
    KeyError
        Where a page asks for what there is not.
    """
    content = read_measured()
    text = _NEW.sub(r"<!-- \1: \2 --><!-- end -->", text)

    def fill(match: re.Match) -> str:
        begin, kind, name, end = match.groups()
        if kind == "value":
            return f"{begin}{getattr(Budget(), name):g}{end}"
        table = MADE[name]() if name in MADE else measured_table(content[name])
        return f"{begin}\n\n{table}\n\n{end}"

    return _PLACE.sub(fill, text)


def measured_table(content: dict[str, Any]) -> str:
    """A measured table with the command that measures it."""
    return f"{content['note']} (`{content['command']}`)\n\n{write_table(content['header'], content['rows'])}"


def policy_table() -> str:
    """The numbers of the rule as the code has them."""
    rows = []
    for name, field in Policy.model_fields.items():
        reason = " ".join((field.description or "").split())
        rows.append([f"`{name}`", f"{field.default:g}", re.split(r"(?<=\.) ", reason)[0].replace("``", "`")])
    return write_table(["number", "default", "meaning"], rows)


def budget_table() -> str:
    """How much of the runs is used, as the code has it."""
    budget = Budget()
    rows = [
        ["`joint_seconds`, summed over the joints", f"{budget.joint_seconds:,.0f} s"],
        ["`joint_samples`, as recorded", f"{budget.joint_samples:,.0f}"],
        ["`joint_rows`, after the common filter", f"{budget.joint_rows:,.0f}"],
        ["share of these for the test runs, in addition", f"{100 * budget.tested:.0f} %"],
    ]
    return write_table(["of the training runs", "at most"], rows)


def write_table(header: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', '&#124;') for cell in line)} |" for line in lines)


#: Tables that are made from the code.
MADE: dict[str, Callable[[], str]] = {"policy": policy_table, "budget": budget_table}
