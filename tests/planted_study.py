"""Tables of a small planted study by name, made by the functions that a study calls."""

from functools import cache

import numpy as np

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


@cache
def make_tables():
    points = planted_test_quantities(cycles=("a",), axes=(1, 2), fdas=("A", "C"), seed=3)[0]
    points["status"] = "ok"
    surrogates = fit_surrogates(points, ["full", "simplified"])
    snr = snr_table(surrogates, runs=500, draws=50)
    deltas, sigmas = np.linspace(0, 4, 5), np.linspace(0.1, 1, 4)
    scope = scope_table(surrogates, deltas=deltas, sigmas=sigmas, runs=500, draws=20)
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
