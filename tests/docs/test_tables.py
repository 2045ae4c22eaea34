"""The data dictionary against the tables that the code writes."""

import re
import sys
from pathlib import Path

from planted_study import make_tables

from wearscope.designs.factors import PAPER_FACTORS

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs" / "site"))
from dictionary import compare_columns, read_dictionary  # noqa: E402

CONTENT = read_dictionary()
FACTORS = [factor.name for factor in PAPER_FACTORS]


def test_every_column_is_described_and_no_other():
    for name, table in make_tables().items():
        described = CONTENT["tables"][name]["columns"]
        assert compare_columns(table.columns, described, FACTORS) == (set(), set()), name


def test_a_new_column_would_be_found():
    columns, described = [*make_tables()["snr"].columns, "novel"], CONTENT["tables"]["snr"]["columns"]
    assert compare_columns(columns, described, FACTORS) == ({"novel"}, set())
    assert compare_columns(columns[1:-1], described, FACTORS) == (set(), {columns[0]})


def test_every_meaning_is_there():
    for name, table in CONTENT["tables"].items():
        assert table["what"].endswith("."), name
        for column, meaning in table["columns"].items():
            assert meaning or CONTENT["columns"].get(column), f"{name}: {column}"


def test_every_table_of_the_workflow_is_described():
    rules = "".join(path.read_text() for path in (ROOT / "workflow" / "rules").glob("*.smk"))
    outputs = set(re.findall(r'f"\{R\}/((?:design/)?[a-z_]+)\.parquet"', rules))
    assert {"snr", "scope", "direct"} <= outputs
    assert outputs <= CONTENT["tables"].keys()
