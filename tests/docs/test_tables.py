"""The data dictionary against the tables that the code writes."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.planted import PAPER_OPTIONS, planted_test_quantities
from wearscope.designs.checks import describe_design
from wearscope.designs.factors import PAPER_FACTORS
from wearscope.designs.kinds import make_design
from wearscope.evaluation.ranking import rank_by_median
from wearscope.evaluation.scope import group_scope, scope_table
from wearscope.evaluation.sensitivity import sensitivity_of
from wearscope.evaluation.snr import snr_table
from wearscope.surrogates.fitting import fit_surrogates
from wearscope.surrogates.validation import validate_surrogates

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs" / "site"))
from dictionary import compare_columns, read_dictionary  # noqa: E402

CONTENT = read_dictionary()
FACTORS = [factor.name for factor in PAPER_FACTORS]


@pytest.fixture(scope="module")
def written():
    """Tables of a planted study by name, made by the functions that a study calls."""
    points = planted_test_quantities(cycles=("a",), axes=(1, 2), fdas=("A", "B"), seed=3)[0]
    points["status"] = "ok"
    surrogates = fit_surrogates(points, ["full", "simplified"])
    validation = validate_surrogates(points, surrogates)
    snr = snr_table(surrogates, runs=500, draws=50)
    grid = {"deltas": np.linspace(0, 4, 3), "sigmas": np.linspace(0.1, 1, 2)}
    scope = scope_table(surrogates, **grid, runs=500, draws=20)
    design = make_design("central_composite", PAPER_FACTORS, PAPER_OPTIONS)
    return {
        "design/identification": design,
        "design/checks": describe_design(design, PAPER_FACTORS),
        "test_quantities": points,
        "surrogates": surrogates,
        "validation": validation,
        "sensitivity": sensitivity_of([surrogates]),
        "snr": snr,
        "ranking": rank_by_median(snr, draws=50),
        "scope": scope,
        "group_scope": group_scope(scope),
    }


def undocumented(columns, described):
    return compare_columns(columns, described, FACTORS)


@pytest.mark.parametrize(
    "name",
    [
        "design/identification", "design/checks", "test_quantities", "surrogates", "validation",
        "sensitivity", "snr", "ranking", "scope", "group_scope",
    ],
)  # fmt: skip
def test_every_column_is_described_and_no_other(written, name):
    assert undocumented(written[name].columns, CONTENT["tables"][name]["columns"]) == (set(), set())


def test_a_new_column_would_be_found(written):
    columns = [*written["snr"].columns, "novel"]
    assert undocumented(columns, CONTENT["tables"]["snr"]["columns"]) == ({"novel"}, set())
    assert undocumented(columns[1:-1], CONTENT["tables"]["snr"]["columns"]) == (set(), {columns[0]})


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
