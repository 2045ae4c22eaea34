"""Where a detector works (Q-3): scope matrices (12) to (16), exactly and by Monte Carlo, and their groups.

With w = s x, x standard normal, y = a + b w + c w^2 is A + B x + C x^2, and P(y >= h) is a difference of
two normal distribution functions at the roots of A + B x + C x^2 = h.
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
#: A grid cell is sure where it passes for at least this share of a surrogate's draws.
SURE = 0.95
COUNTS = ("cells", "passes", "known", "sure", "differ")
_GRID = ["factor", "method", "delta", "sigma"]


def choose_method(scope: pd.DataFrame) -> pd.DataFrame:
    """Rows of the exact method, or of the other method where the study did not ask for the exact one."""
    exact = scope["method"] == "exact"
    return scope[exact] if exact.any() else scope


def count_scope(scope: pd.DataFrame, by: Sequence[str] = ("fda",)) -> pd.DataFrame:
    """Counts of the cells of each group at each point of the grid.

    Parameters
    ----------
    scope : DataFrame
        From `wearscope.evaluation.scope.scope_table`; ``confidence`` may be missing.
    by : sequence of str
        Any subset of ``robot``, ``cycle``, ``axis``, ``fda``.

    Returns
    -------
    DataFrame
        The group columns, ``factor``, ``method``, ``delta``, ``sigma``, sorted, then numbers of ``cells``, of
        those that pass (``passes``), whose confidence is known (``known``) and at least `SURE` (``sure``),
        and, on the rows of the exact method, whose verdict by the other method differs (``differ``).
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
    """Sum of the counts of parts with different cells; memory holds one part and the sum at a time.

    Parameters
    ----------
    parts : iterable of DataFrame
        From `count_scope`, or from `group_scope`, by the same groups.
    """
    total: pd.DataFrame | None = None
    for part in parts:
        total = part if total is None else _add(pd.concat([total, part], ignore_index=True))
    if total is None:
        raise ValueError("no part to count")
    return total


def count_matrix(rows: pd.DataFrame, passing: object) -> tuple[Array, Array, Array]:
    """Number of passing cells on the grid.

    Parameters
    ----------
    rows : DataFrame
        One method's rows, of cells or of counts.
    passing : array (N,)
        Whether a row's cell passes, or how many of its cells do.

    Returns
    -------
    sigma (S,), delta (J,), count (J, S)
    """
    table = rows[["delta", "sigma"]].assign(count=np.asarray(passing, dtype=float))
    wide = table.pivot_table(index="delta", columns="sigma", values="count", aggfunc="sum")
    return wide.columns.to_numpy(float), wide.index.to_numpy(float), wide.to_numpy(float)


def _add(table: pd.DataFrame) -> pd.DataFrame:
    counts = [name for name in table.columns if name in COUNTS]
    keys = [name for name in table.columns if name not in COUNTS]
    return table.groupby(keys, sort=True, observed=True)[counts].sum().reset_index()


_REACH = 9.0
#: Brackets that have shrunk to one rounding unit are dropped once fewer than this share still shrink.
_CROWDED = 0.9


def standardise(coefficients: ArrayLike, sigma: ArrayLike) -> Array:
    """Coefficients in x of y = a + b w + c w^2, w = sigma x.

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
    """P(A + B x + C x^2 >= h) for standard normal x.

    The roots are taken in the form that does not cancel, so C may be zero or tiny.

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
    """Standard deviation sqrt(B^2 + 2 C^2), shape (...,)."""
    quadratic = np.asarray(quadratic, dtype=float)
    return np.hypot(quadratic[..., 1], np.sqrt(2.0) * quadratic[..., 2])


def threshold(quadratic: ArrayLike, probability: ArrayLike) -> Array:
    """Smallest h with P(y >= h) <= `probability`, by bisection on the exact distribution.

    The bracket is the range of y over |x| <= 9; it is halved until it is one rounding unit wide, and its
    upper end is returned.

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
    for _ in range(200):  # next to 0, numbers go on for longer
        middle = 0.5 * (low + high)
        shrinks = (middle > low) & (middle < high)
        left = np.count_nonzero(shrinks)
        if left == 0:
            break
        if left < _CROWDED * len(where):  # some need half as many steps as others
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
    """P_d (14) at the threshold that P_f' sets, exactly.

    Parameters
    ----------
    null, alternative : array (..., 3)
        A, B, C under H0 and H1, of shapes that broadcast.
    false_alarm : float
        P_f'.

    Returns
    -------
    array (...,)
        Where y does not vary under H0, the threshold lies just above that value, and P_d = P(y > it).
    """
    return tail_probability(alternative, alarm_threshold(null, false_alarm))


def alarm_threshold(null: ArrayLike, false_alarm: ArrayLike) -> Array:
    """Threshold (...,) that a false-alarm rate sets; just above y where y does not vary under H0 (..., 3)."""
    null = np.asarray(null, dtype=float)
    scale = 1e-12 * np.maximum(np.abs(null).max(axis=-1), np.finfo(float).tiny)
    return np.where(spread(null) <= scale, null[..., 0] + scale, threshold(null, false_alarm))


def along_operator(
    surrogate: Surrogate, factor: str, levels: Mapping[str, float], faults: ArrayLike
) -> Array:
    """Matrices (J, p, 3) that turn coefficients into a, b, c of `Surrogate.along` at fault levels (J,)."""
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
    """Share of coefficient draws for which a grid cell meets (12), by the exact method.

    Parameters
    ----------
    surrogate : Surrogate
    factor : str
        The nuisance that varies.
    deltas, sigmas : array (J,), (S,)
    levels : mapping
        Coded levels of the other nuisances.
    rng : numpy.random.Generator
    draws : int
        Coefficient vectors, see `Surrogate.draw_coefficients`; the share has a standard error of at most
        0.5 / sqrt(draws).
    f0, false_alarm, detection : float
        As in `wearscope.evaluation.scope.scope_table`.

    Returns
    -------
    array (S, J)
        0 for a constant detector; NaN without residual degrees of freedom or draws.
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
