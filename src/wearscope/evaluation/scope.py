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
from wearscope.evaluation.grouping import check_group
from wearscope.surrogates.fitting import (
    CELL,
    Surrogate,
    expand_coefficients,
    hold_levels,
)

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
        From `wearscope.evaluation.sampled_scope.scope_table`; ``confidence`` may be missing.
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
    null : array (S, 1, 3)
    alternatives : array (S, J, 3)
    """
    held = dict(nominal_levels(PAPER_FACTORS) if levels is None else levels)
    rows = np.stack([surrogate.along(factor, {**held, FAULT: f0 + d}) for d in (0.0, *deltas)])
    standard = standardise(rows, sigmas[:, None])
    return standard[:, :1], standard[:, 1:]


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
