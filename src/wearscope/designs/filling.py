"""Runs in addition to the paper's design: space-filling runs, runs near the questions, checking runs."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from wearscope.designs.factors import (
    CODED_HIGH,
    CODED_LOW,
    FAULT,
    Factor,
    check_factors,
    nominal_levels,
    worn_factor,
)
from wearscope.designs.kinds import design_table, make_design
from wearscope.errors import InputError


def filling_design(
    factors: Sequence[Factor],
    points: int = 36,
    question_points: int = 8,
    replicates: int = 6,
    questions: Sequence[str] = ("w3", "w5"),
    axes: Sequence[int] = (1, 2, 3),
    seed: int = 0,
) -> pd.DataFrame:
    """Points that the chosen surrogates learn from, in addition to those of the paper's design.

    They are a Latin hypercube over the whole region, with every second point drawn towards nominal, where SNR
    and scope are computed; points along the lines of the scope, with wear of one axis; and replicates of some
    points of the hypercube, which differ in sensor noise only.

    Parameters
    ----------
    factors : sequence of Factor
    points : int
        Of the Latin hypercube.
    question_points : int
        For each axis. The first is the nominal point z0 (18) of all axes; a quarter is without wear.
    replicates : int
        At most `points`.
    questions : sequence of str
        Nuisances that the scope varies.
    axes : sequence of int
    seed : int
        The study's root seed; the points have a stream of their own.

    Returns
    -------
    DataFrame
        ``point`` (from 1), coded and natural columns, as `wearscope.designs.kinds.make_design`.

    Raises
    ------
    InputError
        Fewer than 2 points, more replicates than points, an unknown factor.
    """
    if replicates > points:
        raise InputError(f"filling: {replicates} replicates of {points} points; give at most as many.")
    cube = _hypercube(factors, points, "filling", seed)
    nominal = np.array([factor.nominal_coded for factor in factors])
    near = cube[1::2]  # a view of `z`, so that every second point is drawn towards nominal
    end = np.where(near < nominal, CODED_LOW, CODED_HIGH)
    reach = np.abs(end - nominal)
    share = np.divide(np.abs(near - nominal), reach, out=np.zeros_like(near), where=reach > 0)
    near[:] = nominal + (end - nominal) * share**2
    for k, factor in enumerate(factors):
        if factor.is_costly:
            levels = np.linspace(CODED_LOW, CODED_HIGH, factor.levels)
            cube[:, k] = levels[np.argmin(np.abs(cube[:, k, None] - levels), axis=1)]
    asked = question_lines(factors, question_points, questions, axes, "filling", seed)
    return design_table(np.vstack([cube, asked, cube[:replicates]]), factors)


def checking_design(
    factors: Sequence[Factor],
    points: int = 24,
    question_points: int = 2,
    questions: Sequence[str] = ("w3", "w5"),
    axes: Sequence[int] = (1, 2, 3),
    seed: int = 0,
) -> pd.DataFrame:
    """Points on which a chosen surrogate's fit is stated; no fit and no choice sees them.

    A Latin hypercube, uniform over the whole region, and points along the lines that the scope asks about,
    z0 (18) among them. Parameters, columns and errors as `filling_design`.
    """
    cube = _hypercube(factors, points, "checking", seed)
    asked = question_lines(factors, question_points, questions, axes, "checking", seed)
    return design_table(np.vstack([cube, asked]), factors)


def local_design(
    factors: Sequence[Factor], points: int, replicates: int, reach: float, seed: int = 0
) -> pd.DataFrame:
    """Points about the centre of the design, where the SNR (11) is computed; some are simulated twice.

    Parameters
    ----------
    factors : sequence of Factor
    points : int
        Of a Latin hypercube.
    replicates : int
        At most `points`.
    reach : float
        Largest coded level.
    seed : int

    Returns
    -------
    DataFrame
        As `filling_design`.

    Raises
    ------
    InputError
        Fewer than 2 points, or more replicates than points.
    """
    if replicates > points:
        raise InputError(f"local design: {replicates} replicates of {points} points; give at most as many.")
    cube = _hypercube(factors, points, "local", seed) * (reach / CODED_HIGH)
    return design_table(np.vstack([cube, cube[:replicates]]), factors)


def question_lines(
    factors: Sequence[Factor],
    points: int,
    questions: Sequence[str],
    axes: Sequence[int],
    stream: str,
    seed: int,
) -> np.ndarray:
    """Coded points (M, n) of the scope's questions: one axis worn, one nuisance varied, all else nominal.

    z0 comes first; then `points` for each axis (one fewer for the first), the nuisances by turns.
    """
    names = [factor.name for factor in factors]
    unknown = [name for name in questions if name not in names or name == FAULT]
    if unknown or not questions:
        raise InputError(f"filling: questions {list(questions)}; name nuisances among {', '.join(names)}.")
    nominal = nominal_levels(factors)
    z0 = np.array([nominal[name] for name in names])
    rows = [z0] if points else []
    for axis in axes if points else ():
        spread = _hypercube(factors, max(points, 2), f"{stream} questions {axis}", seed)
        worn = names.index(worn_factor(factors, axis))
        for k in range(points):
            if axis == axes[0] and k == 0:
                continue  # z0 is that point
            row = z0.copy()
            varied = names.index(questions[k % len(questions)])
            row[varied] = spread[k, varied]
            if k % 4 != 3:
                row[worn] = spread[k, worn]
            rows.append(row)
    return np.array(rows).reshape(-1, len(names))


def _hypercube(factors: Sequence[Factor], points: int, stream: str, seed: int) -> np.ndarray:
    check_factors(factors)
    names = [factor.name for factor in factors]
    table = make_design("latin_hypercube", factors, {"points": points, "stream": stream}, seed)
    return table[names].to_numpy(dtype=float, copy=True)
