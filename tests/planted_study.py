"""A small study of known second-order truth: its test quantities, and its tables as a study makes them."""

from functools import cache

import numpy as np
import pandas as pd

from wearscope.designs.bases import model_matrix, model_terms
from wearscope.designs.checks import describe_design, view_for_axis
from wearscope.designs.factors import PAPER_FACTORS
from wearscope.designs.kinds import generator_for, make_design, validation_design
from wearscope.evaluation.ranking import rank_by_median
from wearscope.evaluation.sampled_scope import scope_table
from wearscope.evaluation.scope import group_scope
from wearscope.evaluation.sensitivity import sensitivity_of
from wearscope.evaluation.snr import snr_table
from wearscope.surrogates.fitting import (
    CELL,
    IDENTIFICATION,
    VALIDATION,
    cell_name,
    fit_surrogates,
    surrogates_of,
)
from wearscope.surrogates.validation import validate_surrogates

PAPER_OPTIONS = {"generators": {"w5": "f w1 w2 w3 w4"}}


def planted_test_quantities(
    robots=("medium", "large"), cycles=("a", "b"), axes=(1, 2, 3), fdas=("A", "B", "C"), noise=0.02, seed=0
):
    """Make test quantities of the paper's design whose full model (3) is known.

    The direct effect of the fault is 1; the other coefficients are drawn, main effects with deviation 0.3,
    second-order ones with 0.05.

    `noise` is the standard deviation added to each value. Returned are the sets ``identification`` and
    ``validation``, and by (robot, cycle, axis, fda) the coefficients (28,) of ``model_terms("full", ...)``.
    """
    names = [factor.name for factor in PAPER_FACTORS]
    terms = model_terms("full", names)
    designs = {
        IDENTIFICATION: make_design("central_composite", PAPER_FACTORS, PAPER_OPTIONS),
        VALIDATION: validation_design("central_composite", PAPER_FACTORS, PAPER_OPTIONS),
    }
    parts, truth = [], {}
    for key in pd.MultiIndex.from_product([robots, cycles, axes, fdas]):
        rng = generator_for(seed, "planted", cell_name(key))
        deviation = np.where([":" in term or "^" in term for term in terms], 0.05, 0.3)
        theta = rng.normal(0.0, deviation)
        theta[:2] = 3.0, 1.0
        truth[tuple(key)] = theta
        for name, design in designs.items():
            part = view_for_axis(design, key[2])[["point", *names]]
            part.insert(0, "set", name)
            for column, value in zip(reversed(CELL), reversed(key), strict=True):
                part.insert(0, column, value)
            phi = model_matrix(part[names].to_numpy(), names, terms)
            part["y"] = phi @ theta + noise * rng.standard_normal(len(part))
            parts.append(part)
    return pd.concat(parts, ignore_index=True), truth


@cache
def make_tables():
    points = planted_test_quantities(cycles=("a",), axes=(1, 2), fdas=("A", "C"), seed=3)[0]
    points["status"] = "ok"
    surrogates = fit_surrogates(points, ["full", "simplified"])
    snr = snr_table(surrogates_of(surrogates, "full"), runs=500, draws=50)
    deltas, sigmas = np.linspace(0, 4, 5), np.linspace(0.1, 1, 4)
    cells = surrogates_of(surrogates, "full")
    scope = scope_table(cells, deltas=deltas, sigmas=sigmas, runs=500, draws=20)
    design = make_design("central_composite", PAPER_FACTORS, PAPER_OPTIONS)
    return {
        "design/identification": design,
        "design/checks": describe_design(design, PAPER_FACTORS),
        "test_quantities": points,
        "surrogates": surrogates,
        "validation": validate_surrogates(points, surrogates),
        "sensitivity": sensitivity_of([surrogates]),
        "snr": snr,
        "ranking": rank_by_median(snr, draws=50),
        "scope": scope,
        "group_scope": group_scope(scope),
    }
