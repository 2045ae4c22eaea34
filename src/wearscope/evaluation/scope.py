"""Scope of detectors (Q-3): scope matrices (12) to (16), exactly and by Monte Carlo, and counts over groups.

A quadratic surrogate gives y = a + b w + c w^2 along a nuisance w = sigma x with x standard normal, which is
A + B x + C x^2. So P(y >= h) follows exactly from normal distribution functions at the roots of
A + B x + C x^2 = h.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from wearscope.designs.factors import FAULT, PAPER_FACTORS, nominal_levels
from wearscope.designs.kinds import generator_for
from wearscope.errors import InputError
from wearscope.evaluation.grouping import check_group
from wearscope.evaluation.snr import output_status
from wearscope.surrogates.fitting import (
    CELL,
    Surrogate,
    cell_name,
    expand_coefficients,
    hold_levels,
    surrogates_of,
)

METHODS = ("exact", "kde")
Array = NDArray[np.float64]
#: A grid point is sure where it passes for at least this share of the draws of a surrogate.
SURE = 0.95
#: Columns of counts; all other columns are keys.
COUNTS = ("cells", "passes", "known", "sure", "differ")
_GRID = ["factor", "method", "delta", "sigma"]


def choose_method(scope: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the exact method; those of the other method where the table has no exact rows."""
    exact = scope["method"] == "exact"
    return scope[exact] if exact.any() else scope


def count_scope(scope: pd.DataFrame, by: Sequence[str] = ("fda",)) -> pd.DataFrame:
    """Count the cells of each group at each grid point.

    Parameters
    ----------
    scope : DataFrame
        From `wearscope.evaluation.scope.scope_table`; ``confidence`` may be missing.
    by : sequence of str
        Any subset of ``robot``, ``cycle``, ``axis``, ``fda``.

    Returns
    -------
    DataFrame
        The group columns, ``factor``, ``method``, ``delta``, ``sigma``, sorted; then the number of all
        ``cells``, of those that pass (``passes``), of those whose confidence is known (``known``), of those
        with a confidence of at least `SURE` (``sure``), and, in rows of the exact method, of those for which
        the other method's verdict differs (``differ``).
    """
    differ = np.zeros(len(scope), dtype=np.int64)
    rows = scope
    if 2 * (scope["method"] == "exact").sum() == len(scope):
        rows = scope.sort_values([*CELL, *_GRID], kind="stable")
        exact, passes = (rows["method"] == "exact").to_numpy(), rows["passes"].to_numpy(dtype=bool)
        differ[exact] = passes[exact] != passes[~exact]
    confidence = rows["confidence"] if "confidence" in rows else pd.Series(np.nan, index=rows.index)
    marked = rows[[*check_group(by), *_GRID]].assign(
        cells=1,
        passes=rows["passes"].to_numpy(dtype=np.int64),
        known=confidence.notna().to_numpy(dtype=np.int64),
        sure=(confidence >= SURE).to_numpy(dtype=np.int64),
        differ=differ,
    )
    return _add(marked)


def add_counts(parts: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Add the counts of parts with different cells; only one part and the sum are in memory at a time.

    Parameters
    ----------
    parts : iterable of DataFrame
        From `count_scope` or `group_scope`, with the same groups.
    """
    total: pd.DataFrame | None = None
    for part in parts:
        total = part if total is None else _add(pd.concat([total, part], ignore_index=True))
    if total is None:
        raise ValueError("no part to count")
    return total


def count_matrix(rows: pd.DataFrame, passing: object) -> tuple[Array, Array, Array]:
    """Arrange the number of passing cells as a matrix on the grid.

    Parameters
    ----------
    rows : DataFrame
        Rows of one method, of cells or of counts.
    passing : array (N,)
        For each row, whether its cell passes, or the number of its cells that pass.

    Returns
    -------
    sigma (S,), delta (J,), count (J, S)
    """
    table = rows[["delta", "sigma"]].assign(count=np.asarray(passing, dtype=float))
    wide = table.pivot_table(index="delta", columns="sigma", values="count", aggfunc="sum")
    return wide.columns.to_numpy(float), wide.index.to_numpy(float), wide.to_numpy(float)


def _add(table: pd.DataFrame) -> pd.DataFrame:
    """Add the counts of rows with equal keys."""
    counts = [name for name in table.columns if name in COUNTS]
    keys = [name for name in table.columns if name not in COUNTS]
    return table.groupby(keys, sort=True, observed=True)[counts].sum().reset_index()


#: Range of a standard normal variable that is searched for a threshold, -9 to 9.
_REACH = 9.0
#: The bisection drops its finished brackets once fewer than this share of them still shrink.
_CROWDED = 0.9


def standardise(coefficients: ArrayLike, sigma: ArrayLike) -> Array:
    """Return the coefficients in x of y = a + b w + c w^2 with w = sigma x.

    Parameters
    ----------
    coefficients : array (..., 3)
        a, b, c.
    sigma : array (...,)

    Returns
    -------
    array (..., 3)
        A, B, C.
    """
    a, b, c = np.moveaxis(np.asarray(coefficients, dtype=float), -1, 0)
    s = np.asarray(sigma, dtype=float)
    a, b, c, s = np.broadcast_arrays(a, b, c, s)
    return np.stack([a, b * s, c * s * s], axis=-1)


def tail_probability(quadratic: ArrayLike, h: ArrayLike) -> Array:
    """Return P(A + B x + C x^2 >= h) for standard normal x.

    The roots are computed in the form without cancellation, so that C may be zero or tiny.

    Parameters
    ----------
    quadratic : array (..., 3)
    h : array (...,)

    Returns
    -------
    array (...,)
    """
    a, b, c = np.moveaxis(np.asarray(quadratic, dtype=float), -1, 0)
    a, b, c, h = np.broadcast_arrays(a, b, c, np.asarray(h, dtype=float))
    b = np.abs(b)
    lift = h - a
    discriminant = b * b + 4 * c * lift
    inside = discriminant >= 0
    root = np.sqrt(np.where(inside, discriminant, 0.0))
    half = -0.5 * (b + root)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        near = np.where(half != 0, -lift / half, 0.0)
        far = np.where(c != 0, half / c, -np.inf)
    low, high = np.minimum(near, far), np.maximum(near, far)
    up = c > 0
    below, beyond = ndtr(low), ndtr(np.where(up, -high, high))
    curved = np.where(inside, np.where(up, below + beyond, beyond - below), up.astype(float))
    flat = c == 0
    if not flat.any():
        return curved
    straight = np.where(b > 0, ndtr(-near), (lift <= 0).astype(float))
    return np.where(flat, straight, curved)


def spread(quadratic: ArrayLike) -> Array:
    """Return the standard deviation sqrt(B^2 + 2 C^2) of y, shape (...,)."""
    quadratic = np.asarray(quadratic, dtype=float)
    return np.hypot(quadratic[..., 1], np.sqrt(2.0) * quadratic[..., 2])


def threshold(quadratic: ArrayLike, probability: ArrayLike) -> Array:
    """Find the smallest h with P(y >= h) <= `probability` by bisection on the exact distribution.

    The bracket is the range of y over |x| <= 9. It is halved until no floating-point number lies between its
    ends; the upper end is returned.

    Parameters
    ----------
    quadratic : array (..., 3)
    probability : float or array (...,)

    Returns
    -------
    array (...,)
    """
    quadratic, wanted = np.asarray(quadratic, dtype=float), np.asarray(probability, dtype=float)
    shifted = quadratic.copy()
    shifted[..., 0] = 0.0
    b, c = np.abs(quadratic[..., 1]), quadratic[..., 2]
    ends = np.stack([c * _REACH**2 - b * _REACH, c * _REACH**2 + b * _REACH])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        turn = np.where(c != 0, -b / (2 * c), np.inf)
        vertex = np.where(np.abs(turn) < _REACH, -b * b / (4 * c), 0.0)
    low = np.minimum(np.minimum(ends[0], ends[1]), vertex)
    high = np.maximum(np.maximum(ends[0], ends[1]), vertex)
    shape = np.broadcast_shapes(high.shape, wanted.shape)
    asked = np.broadcast_to(shifted, (*shape, 3)).reshape(-1, 3)
    wanted, low, high = (np.broadcast_to(one, shape).ravel() for one in (wanted, low, high))
    found, where = high.copy(), np.arange(high.size)
    for _ in range(200):  # more steps than a bracket next to 0 needs
        middle = 0.5 * (low + high)
        shrinks = (middle > low) & (middle < high)
        left = np.count_nonzero(shrinks)
        if left == 0:
            break
        if left < _CROWDED * len(where):  # some brackets need only half as many steps as others
            found[where] = high
            where, asked, wanted = where[shrinks], asked[shrinks], wanted[shrinks]
            low, high, middle = low[shrinks], high[shrinks], middle[shrinks]
        above = tail_probability(asked, middle) > wanted
        low = np.where(above, middle, low)
        high = np.where(above, high, middle)
    found[where] = high
    high = found.reshape(shape)
    return quadratic[..., 0] + high


def detection_probability(null: ArrayLike, alternative: ArrayLike, false_alarm: float = 0.01) -> Array:
    """Return P_d (14), exactly, at the threshold that the probability of false alarm P_f' requires.

    Parameters
    ----------
    null, alternative : array (..., 3)
        A, B, C under H0 and H1; the shapes must broadcast.
    false_alarm : float
        P_f'.

    Returns
    -------
    array (...,)
        Where y is constant under H0, the threshold lies just above that constant.
    """
    return tail_probability(alternative, alarm_threshold(null, false_alarm))


def alarm_threshold(null: ArrayLike, false_alarm: ArrayLike) -> Array:
    """Return the threshold (...,) for a probability of false alarm; just above y where it is constant."""
    null = np.asarray(null, dtype=float)
    scale = 1e-12 * np.maximum(np.abs(null).max(axis=-1), np.finfo(float).tiny)
    return np.where(spread(null) <= scale, null[..., 0] + scale, threshold(null, false_alarm))


def along_operator(
    surrogate: Surrogate, factor: str, levels: Mapping[str, float], faults: ArrayLike
) -> Array:
    """Return matrices (J, p, 3) that map a surrogate's coefficients to a, b, c along a factor.

    a, b, c are those of `Surrogate.along`, at the fault levels (J,).
    """
    names = surrogate.names
    k = names.index(factor)
    z = hold_levels(names, {**levels, factor: 0.0}, {FAULT: np.atleast_1d(faults)})
    constant, linear, q = expand_coefficients(np.eye(len(surrogate.terms)), surrogate.terms, names)
    level = constant + z @ linear.T + ((z @ q) * z).sum(axis=-1).T
    slope = linear[:, k] + 2 * z @ q[:, k].T
    return np.stack([level, slope, np.broadcast_to(q[:, k, k], slope.shape)], axis=-1)


def pass_confidence(
    surrogate: Surrogate,
    factor: str,
    deltas: Array,
    sigmas: Array,
    levels: Mapping[str, float],
    rng: np.random.Generator,
    draws: int = 200,
    f0: float = -2.0,
    false_alarm: float = 0.01,
    detection: float = 0.99,
) -> Array:
    """Return the share of coefficient draws for which a grid point meets (12), by the exact method.

    Parameters
    ----------
    surrogate : Surrogate
    factor : str
        Nuisance that varies.
    deltas, sigmas : array (J,), (S,)
    levels : mapping
        Coded levels of the other nuisances.
    rng : numpy.random.Generator
    draws : int
        Number of coefficient vectors, see `Surrogate.draw_coefficients`; the share has a standard error of at
        most 0.5 / sqrt(draws).
    f0, false_alarm, detection : float
        As in `wearscope.evaluation.scope.scope_table`.

    Returns
    -------
    array (S, J)
        0 for a constant test quantity; NaN without residual degrees of freedom or draws.
    """
    shape = (len(sigmas), len(deltas))
    if surrogate.status == "constant":
        return np.zeros(shape)
    if surrogate.dof < 1 or draws < 1:
        return np.full(shape, np.nan)
    theta = surrogate.draw_coefficients(rng, draws)
    maps = along_operator(surrogate, factor, levels, f0 + np.concatenate([[0.0], deltas]))
    along = np.einsum("dp,jpc->jdc", theta, maps)
    null = standardise(along[0], sigmas[:, None])
    worn = standardise(along[1:], sigmas[:, None, None])
    p_d = detection_probability(null[:, None], worn, false_alarm)
    return np.mean(p_d >= detection, axis=-1)


def paper_grid() -> tuple[np.ndarray, np.ndarray]:
    """Return the linear grid (16) of the paper, coded: Delta from 0 to 4, sigma from 0.01 to 1."""
    return np.linspace(0.0, 4.0, 30), np.linspace(0.01, 1.0, 30)


def scope_quadratics(
    surrogate: Surrogate,
    factor: str,
    deltas: np.ndarray,
    sigmas: np.ndarray,
    f0: float = -2.0,
    levels: Mapping[str, float] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the coefficients A, B, C of y = A + B x + C x^2 under the hypotheses (15), x standard normal.

    Parameters
    ----------
    surrogate : Surrogate
    factor : str
        Nuisance that varies, w ~ N(0, sigma^2).
    deltas : array (J,)
    sigmas : array (S,)
    f0 : float
    levels : mapping, optional
        Coded levels of the other factors; by default the nominal point (18).

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
    """Return exact P_d (..., S, J) of eq. (14) on the grid from A, B, C (..., S, 3) and (..., S, J, 3)."""
    return detection_probability(null[..., None, :], alternatives, false_alarm)


def kde_scope(
    null: np.ndarray,
    alternatives: np.ndarray,
    false_alarm: float = 0.01,
    runs: int = 100_000,
    seed: int = 0,
) -> np.ndarray:
    """Compute P_d (14) on the grid by Monte Carlo and kernel density estimates.

    Parameters
    ----------
    null : array (S, 3)
    alternatives : array (S, J, 3)
    false_alarm : float
    runs : int
        Number of draws for each sigma and hypothesis. All fault changes at one sigma share the draws of H1,
        and all cells and factors share all draws.
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
    """Compute the scope matrices of every cell, in long form.

    The rows of a cell do not depend on the other cells, so that a study can be computed in parts.

    Parameters
    ----------
    surrogates : DataFrame
        From `wearscope.surrogates.fitting.fit_surrogates`.
    factors : sequence of str
        Nuisances that vary, one at a time.
    model : str
    methods : sequence of {"exact", "kde"}
    deltas, sigmas : sequence of float, optional
        Coded grid (16); by default `paper_grid`.
    f0 : float
        Coded fault level of H0.
    levels : mapping, optional
        Coded levels at which the other nuisances are fixed; by default the nominal point (18).
    false_alarm, detection : float
        P_f', P_d'.
    runs, seed
        See `kde_scope`.
    draws : int
        Number of coefficient draws for ``confidence``; 0 for none.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``model``, ``factor``, ``delta``, ``sigma``, ``p_d``,
        ``passes``, ``method``, ``status``, ``confidence``. The status is ``ok``, ``constant`` (never passes)
        or ``decreasing``: theta_0 < 0, so that the test quantity falls with wear; it is still judged by rule
        (13), without reversing its sign. The confidence (NaN for kde) is the share of coefficient draws for
        which the grid point passes.

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
    """Raise InputError where grid, methods or probabilities do not allow a scope to be computed."""
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
    """Return a table in long form of blocks (key, factor, method, status, P_d (S, J), confidence (S, J))."""
    size = deltas.size * sigmas.size
    keys, factors, methods, statuses, p_d, confidence = zip(*blocks, strict=True)
    found = np.concatenate([one.ravel() for one in p_d])
    return pd.DataFrame(
        {
            **{name: np.repeat([key[k] for key in keys], size) for k, name in enumerate([*CELL, "model"])},
            "factor": np.repeat(factors, size),
            "delta": np.tile(np.tile(deltas, sigmas.size), len(blocks)),
            "sigma": np.tile(np.repeat(sigmas, deltas.size), len(blocks)),
            "p_d": found,
            "passes": found >= detection,
            "method": np.repeat(methods, size),
            "status": np.repeat(statuses, size),
            "confidence": np.concatenate([one.ravel() for one in confidence]),
        }
    )


def group_scope(scope: pd.DataFrame, by: Sequence[str] = ("fda",)) -> pd.DataFrame:
    """Count in each group how often the requirement is met (Fig. 4), in long form.

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
