"""A small finished study: planted test quantities, everything after them by the real evaluation."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from planted_study import PAPER_OPTIONS, planted_test_quantities
from reporting.browser import launch_browser

from wearscope.config import load_config
from wearscope.designs.checks import describe_design, view_for_axis
from wearscope.designs.factors import Factor, nominal_levels
from wearscope.designs.kinds import make_design
from wearscope.detectors.run import count_failures
from wearscope.evaluation.audit import (
    audit_table,
    audit_verdicts,
    choose_audit_points,
    scope_boundary,
)
from wearscope.evaluation.conclusion import conclude_study, threshold_table
from wearscope.evaluation.ranking import rank_by_median
from wearscope.evaluation.sampled_scope import (
    detection_table,
    response_table,
    scope_table,
    simulated_table,
)
from wearscope.evaluation.sensitivity import sensitivity_of
from wearscope.evaluation.snr import snr_table
from wearscope.reporting.study import Study
from wearscope.robots.friction import friction_curves
from wearscope.robots.model import load_model
from wearscope.surrogates.fitting import fit_surrogates, surrogates_of
from wearscope.surrogates.validation import validate_surrogates

WEAR = {"kind": "wear", "range": [0, 50], "unit": "1", "validation": [5, 45]}
CONFIG = {
    "study": "small",
    "robots": ["medium", "large"],
    "cycles": ["a", "b"],
    "axes": [1, 2],
    "detectors": {"A": "residual_energy", "B": "distribution_distance", "C": "friction_fit"},
    "factors": {
        "f": {"description": "wear of the tested axis", **WEAR},
        "w1": {"description": "wear of the first other axis", **WEAR},
        "w2": {"description": "wear of the second other axis", **WEAR},
        "w3": {"description": "temperature", "kind": "temperature", "range": [30, 70], "unit": "degC"},
        "w4": {"description": "delay", "kind": "dwell", "range": [25, 75], "unit": "ms"},
        "w5": {
            "description": "payload error", "kind": "payload_mass_error", "range": [-10, 10], "unit": "%"
        },
    },
    "snr": {"model": "full"},
    "scope": {"model": "full", "grid": [5, 4], "runs": 500},
}  # fmt: skip


@pytest.fixture(scope="session")
def study():
    """Eight cells a detector; B falls with wear in one, C never changes in another and fails at a point."""
    config = load_config(CONFIG)
    factors = [Factor(**one) for one in config.factor_table()]
    points = planted_test_quantities(cycles=("a", "b"), axes=(1, 2), fdas=("A", "B", "C"), seed=3)[0]
    points["status"] = "ok"
    here = (points["robot"] == "medium") & (points["cycle"] == "a") & (points["axis"] == 1)
    points.loc[here & (points["fda"] == "B"), "y"] *= -1
    points.loc[here & (points["fda"] == "C"), "y"] = 0.3
    failed = (points["robot"] == "large") & (points["fda"] == "C") & (points["point"] == 7)
    failed &= (points["set"] == "identification") & (points["cycle"] == "b") & (points["axis"] == 2)
    points.loc[failed, ["y", "status"]] = np.nan, "ZeroDivisionError: division by <zero>"
    surrogates = fit_surrogates(points, ["full", "simplified"])
    validation = validate_surrogates(points, surrogates)
    snr = snr_table(surrogates_of(surrogates, "full"), runs=500, draws=200)
    grid = {"deltas": np.linspace(0, 4, 5), "sigmas": np.linspace(0.1, 1, 4)}
    scope = scope_table(surrogates_of(surrogates, "full"), **grid, runs=500, draws=50)
    boundaries = {name: scope_boundary(scope, name) for name in ("w3", "w5")}
    chosen = choose_audit_points(factors, boundaries, axes=(1, 2))
    audit = audit_table(_direct(surrogates, chosen), surrogates, chosen)
    design = make_design("central_composite", factors, PAPER_OPTIONS)
    return Study(
        config=config.model_dump(mode="json"),
        factors=factors,
        surrogates=surrogates,
        validation=validation,
        sensitivity=sensitivity_of([surrogates]),
        snr=snr,
        ranking=rank_by_median(snr, draws=200),
        scope=scope,
        failures=count_failures(points),
        checks=describe_design(design, factors),
        audit=audit,
        audit_verdicts=audit_verdicts(audit),
    )


def _direct(surrogates, chosen):
    """Audit runs of cycle a: what the surrogate says, one value far off, one failed."""
    names = ["f", "w1", "w2", "w3", "w4", "w5"]
    parts = []
    for key, surrogate in surrogates_of(surrogates, "full"):
        if key[1] == "a":
            part = view_for_axis(chosen[["point", *names]], key[2])
            part["y"] = surrogate.predict(part[names].to_numpy())
            part["set"] = "audit"
            for name, value in zip(("robot", "cycle", "axis", "fda"), key[:4], strict=True):
                part[name] = value
            parts.append(part)
    parts[0].loc[0, "y"] = np.nan
    parts[1].loc[0, "y"] += 100.0
    return pd.concat(parts, ignore_index=True)


@pytest.fixture
def change(study):
    """Return the study with some fields changed."""

    def make(**fields):
        return replace(study, **fields)

    return make


def scale_term(study, term, factor_by_fda):
    """The study's surrogates with a term's normalised coefficient set, by detector, give or take a little."""
    table = study.surrogates.copy()
    for fda, size in factor_by_fda.items():
        rows = (table["fda"] == fda) & (table["term"] == term)
        table.loc[rows, "theta_normalised"] = size * (1 + 0.01 * (np.arange(rows.sum()) % 4))
    return table


@pytest.fixture
def set_term(study):
    """Return surrogates with the normalised coefficient of a term set by detector."""
    return lambda term, sizes: scale_term(study, term, sizes)


@pytest.fixture(scope="session")
def asked(study):
    """The small study with all that its charts ask for, and loops left out."""
    levels = nominal_levels(study.factors)
    cells = [(key[:4], one) for key, one in surrogates_of(study.surrogates, "full")]
    runs = planted_test_quantities(cycles=("a", "b"), axes=(1, 2), fdas=("A", "B", "C"), seed=3)[0]
    conclusions, rankings = conclude_study([study.scope], study.snr, study.factors, 0.01, 0.99)
    thresholds = [
        threshold_table(cells, one, study.factors, levels, -2.0).assign(asked=one.robot)
        for one in conclusions
    ]
    robot = load_model("medium")
    deltas, sigmas = np.array([1.0, 2.0, 4.0]), np.array([0.1, 0.5])
    return replace(
        study,
        conclusions=conclusions,
        rankings=rankings,
        thresholds=pd.concat(thresholds, ignore_index=True),
        responses=response_table(cells, study.factors, levels, 9),
        simulated=simulated_table(cells, runs, study.factors, levels),
        detection=detection_table(cells, levels, ["w3", "w5"], deltas, sigmas, -2.0, [0.01, 0.05, 0.2]),
        friction=friction_curves(robot, (30.0, 70.0), (0.0, 50.0), points=12),
        units={"A": "-", "B": "-", "C": "N m"},
    )


@pytest.fixture(scope="module")
def browser():
    """A headless browser, where there is one."""
    with launch_browser() as opened:
        yield opened
