"""Test quantities of known second-order truth, for tests and benchmarks."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from wearscope.designs.bases import model_matrix, model_terms
from wearscope.designs.checks import view_for_axis
from wearscope.designs.factors import PAPER_FACTORS
from wearscope.designs.kinds import generator_for, make_design, validation_design
from wearscope.surrogates.fitting import CELL, IDENTIFICATION, VALIDATION, cell_name

PAPER_OPTIONS = {"generators": {"w5": "f w1 w2 w3 w4"}}


def planted_test_quantities(
    robots: Sequence[str] = ("medium", "large"),
    cycles: Sequence[str] = ("a", "b"),
    axes: Sequence[int] = (1, 2, 3),
    fdas: Sequence[str] = ("A", "B", "C"),
    noise: float = 0.02,
    seed: int = 0,
) -> tuple[pd.DataFrame, dict[tuple, np.ndarray]]:
    """Make test quantities of the paper's design whose full model (3) is known.

    The direct effect of the fault is 1; the other coefficients are drawn, main effects with deviation 0.3,
    second-order ones with 0.05.

    Parameters
    ----------
    robots, cycles, axes, fdas : sequences
        The cells.
    noise : float
        Standard deviation added to each value.
    seed : int

    Returns
    -------
    test_quantities : DataFrame
        Sets ``identification`` and ``validation``.
    truth : dict
        Coefficients (28,) by (robot, cycle, axis, fda), in the order of ``model_terms("full", ...)``.
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
