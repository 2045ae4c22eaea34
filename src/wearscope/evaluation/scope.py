"""Where a detector works (Q-3): scope matrices (12) to (16), exactly and by Monte Carlo, and their groups."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from wearscope.designs.factors import FAULT, PAPER_FACTORS, nominal_levels
from wearscope.designs.kinds import generator_for
from wearscope.errors import InputError
from wearscope.evaluation.grouping import check_group
from wearscope.evaluation.scope_confidence import pass_confidence
from wearscope.evaluation.scope_exact import detection_probability, standardise
from wearscope.evaluation.snr import output_status
from wearscope.surrogates.fitting import CELL, cell_name, surrogates_of
from wearscope.surrogates.surrogate import Surrogate

METHODS = ("exact", "kde")


def paper_grid() -> tuple[np.ndarray, np.ndarray]:
    """Linear grid (16) of the paper: Delta in [0, 4], sigma in [0.01, 1], coded."""
    return np.linspace(0.0, 4.0, 30), np.linspace(0.01, 1.0, 30)


def scope_quadratics(
    surrogate: Surrogate,
    factor: str,
    deltas: np.ndarray,
    sigmas: np.ndarray,
    f0: float = -2.0,
    levels: Mapping[str, float] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients A, B, C of y in a standard normal under the hypotheses (15).

    Parameters
    ----------
    surrogate : Surrogate
    factor : str
        The nuisance that varies, w ~ N(0, sigma^2).
    deltas : array (J,)
    sigmas : array (S,)
    f0 : float
    levels : mapping, optional
        Coded levels of the other factors; default the nominal point (18).

    Returns
    -------
    null : array (S, 3)
    alternatives : array (S, J, 3)
    """
    held = dict(nominal_levels(PAPER_FACTORS) if levels is None else levels)
    null = surrogate.along(factor, {**held, FAULT: f0})
    alternatives = np.stack([surrogate.along(factor, {**held, FAULT: f0 + d}) for d in deltas])
    return (
        standardise(null, sigmas),
        standardise(alternatives[None, :, :], sigmas[:, None]),
    )


def exact_scope(null: np.ndarray, alternatives: np.ndarray, false_alarm: float = 0.01) -> np.ndarray:
    """P_d (14) on the grid in closed form; shapes (..., S, 3), (..., S, J, 3) to (..., S, J)."""
    return detection_probability(null[..., None, :], alternatives, false_alarm)


def kde_scope(
    null: np.ndarray,
    alternatives: np.ndarray,
    false_alarm: float = 0.01,
    runs: int = 100_000,
    seed: int = 0,
) -> np.ndarray:
    """P_d (14) on the grid by Monte Carlo and kernel density estimates.

    Parameters
    ----------
    null : array (S, 3)
    alternatives : array (S, J, 3)
    false_alarm : float
    runs : int
        Draws for each sigma and hypothesis; all fault changes at one sigma share those of H1, and all cells
        and factors the same runs.
    seed : int

    Returns
    -------
    array (S, J)
    """
    from wearscope.evaluation.scope_kde import detection_probabilities, draw_runs  # brings numba

    result = np.empty(alternatives.shape[:2])
    for s in range(len(null)):
        x, weights0, weights1 = draw_runs(seed, s, runs)
        powers = np.stack([np.ones_like(x), x, x * x])
        result[s] = detection_probabilities(
            null[s] @ powers, alternatives[s] @ powers, weights0, weights1, runs, false_alarm
        )
    return result


def scope_table(
    surrogates: pd.DataFrame,
    factors: Sequence[str] = ("w3", "w5"),
    model: str = "full",
    methods: Sequence[str] = METHODS,
    deltas: Sequence[float] | None = None,
    sigmas: Sequence[float] | None = None,
    f0: float = -2.0,
    levels: Mapping[str, float] | None = None,
    false_alarm: float = 0.01,
    detection: float = 0.99,
    runs: int = 100_000,
    seed: int = 0,
    draws: int = 200,
) -> pd.DataFrame:
    """Scope matrices of every cell, long form.

    Rows of a subset of the cells are those of the whole, so a study may be cut anywhere.

    Parameters
    ----------
    surrogates : DataFrame
        From `wearscope.surrogates.fitting.fit_surrogates`.
    factors : sequence of str
        Nuisances to vary, one at a time.
    model : str
    methods : sequence of {"exact", "kde"}
    deltas, sigmas : sequence of float, optional
        Grid (16), coded; default `paper_grid`.
    f0 : float
        Coded fault level of H0.
    levels : mapping, optional
        Coded levels at which the other nuisances are held; default the nominal point (18).
    false_alarm, detection : float
        P_f', P_d'.
    runs, seed
        See `kde_scope`.
    draws : int
        Coefficient draws for ``confidence``; 0 for none.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``model``, ``factor``, ``delta``, ``sigma``, ``p_d``,
        ``passes``, ``method``, ``status``: ``ok``; ``constant`` (never passes); ``decreasing``: theta_0 < 0,
        judged by rule (13) as it stands, never with its sign turned. ``confidence`` (method exact, else
        NaN): share of coefficient draws for which the grid cell passes.

    Raises
    ------
    InputError
        Unknown factor or method, an empty grid, a non-positive sigma, probabilities out of order.
    """
    grid_d, grid_s = paper_grid()
    grid_d = grid_d if deltas is None else np.asarray(deltas, dtype=float)
    grid_s = grid_s if sigmas is None else np.asarray(sigmas, dtype=float)
    check_setting(grid_d, grid_s, methods, false_alarm, detection, runs)
    held = nominal_levels(PAPER_FACTORS) if levels is None else dict(levels)
    blocks = []
    for key, surrogate in surrogates_of(surrogates, model):
        for factor in factors:
            if factor not in surrogate.names or factor == FAULT:
                raise InputError(f"scope: '{factor}' is no nuisance; use {', '.join(surrogate.names[1:])}.")
            null, alternatives = scope_quadratics(surrogate, factor, grid_d, grid_s, f0, held)
            for method in methods:
                if method == "exact":
                    p_d = exact_scope(null, alternatives, false_alarm)
                    stream = generator_for(seed, "scope confidence", cell_name(key), factor)
                    sure = pass_confidence(
                        surrogate, factor, grid_d, grid_s, held, stream, draws, f0, false_alarm, detection
                    )  # fmt: skip
                else:
                    p_d = kde_scope(null, alternatives, false_alarm, runs, seed)
                    sure = np.full(p_d.shape, np.nan)
                blocks.append((key, factor, method, output_status(surrogate), p_d, sure))
    return long_table(blocks, grid_d, grid_s, detection)


def check_setting(
    deltas: np.ndarray,
    sigmas: np.ndarray,
    methods: Sequence[str],
    p_f: float,
    p_d: float,
    runs: int,
) -> None:
    """Refuse a grid, methods or probabilities that no scope can be computed with, by InputError."""
    if deltas.size == 0 or sigmas.size == 0 or not np.all(sigmas > 0):
        raise InputError(
            "scope: the grid is empty or has a sigma that is not positive; correct deltas or sigmas."
        )
    wrong = [method for method in methods if method not in METHODS]
    if wrong or not methods:
        raise InputError(f"scope: methods {list(methods)}; choose among {', '.join(METHODS)}.")
    if not 0 < p_f < p_d < 1:
        raise InputError(f"scope: P_f' {p_f} and P_d' {p_d} must lie between 0 and 1, in that order.")
    if "kde" in methods and runs < 100:
        raise InputError(f"scope: {runs} runs; use at least 100.")


def long_table(blocks: list, deltas: np.ndarray, sigmas: np.ndarray, detection: float) -> pd.DataFrame:
    """Long form of blocks (key, factor, method, status, P_d (S, J), confidence (S, J))."""
    size = deltas.size * sigmas.size
    columns: dict[str, object] = {}
    for k, name in enumerate([*CELL, "model"]):
        columns[name] = np.repeat(np.array([block[0][k] for block in blocks]), size)
    columns["factor"] = np.repeat(np.array([block[1] for block in blocks]), size)
    columns["delta"] = np.tile(np.tile(deltas, sigmas.size), len(blocks))
    columns["sigma"] = np.tile(np.repeat(sigmas, deltas.size), len(blocks))
    p_d = np.concatenate([block[4].ravel() for block in blocks])
    columns["p_d"] = p_d
    columns["passes"] = p_d >= detection
    columns["method"] = np.repeat(np.array([block[2] for block in blocks]), size)
    columns["status"] = np.repeat(np.array([block[3] for block in blocks]), size)
    columns["confidence"] = np.concatenate([block[5].ravel() for block in blocks])
    return pd.DataFrame(columns)


def group_scope(scope: pd.DataFrame, by: Sequence[str] = ("fda",)) -> pd.DataFrame:
    """Group scope matrices: how often the requirement is met (Fig. 4), long form.

    Parameters
    ----------
    scope : DataFrame
        From `scope_table`.
    by : sequence of str
        Any subset of ``robot``, ``cycle``, ``axis``, ``fda``.

    Returns
    -------
    DataFrame
        The group columns, ``model``, ``factor``, ``method``, ``sigma``, ``delta``, ``passes`` (sum over the
        group), ``cells`` (number of scope matrices in it).
    """
    keys = [*check_group(by), "model", "factor", "method", "sigma", "delta"]
    grouped = scope.groupby(keys, sort=True, observed=True)["passes"]
    return grouped.agg(passes="sum", cells="size").reset_index()


def add_group_scopes(parts: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Group scope matrices of all parts, each of other cells, from `group_scope` by the same groups."""
    if len(parts) == 1:
        return parts[0]
    table = pd.concat(parts, ignore_index=True)
    keys = [name for name in table.columns if name not in ("passes", "cells")]
    return table.groupby(keys, sort=True, observed=True)[["passes", "cells"]].sum().reset_index()
