"""Threshold and detection probability (13), (14) at any probability of false alarm: ROC of every cell.

They rest on responses: a surrogate's test quantity over one factor at a time. Tolerance is the scope in one
number: how much a nuisance may vary until a fault is no longer detected.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from wearscope.designs.factors import CODED_HIGH, CODED_LOW, Factor
from wearscope.evaluation.sampled_scope import (
    SPREAD,
    WEIGHTS,
    Tabulated,
    interpolation,
    tabulated_scope,
    weighted_threshold,
)
from wearscope.evaluation.scope import alarm_threshold, scope_quadratics, tail_probability
from wearscope.surrogates.fitting import CELL
from wearscope.surrogates.selection import ChosenSurrogate
from wearscope.surrogates.surrogate import Surrogate, hold_levels

STEPS = 33

#: A surrogate by its cell (robot, cycle, axis, fda).
Cells = Iterable[tuple[tuple, ChosenSurrogate | Surrogate]]


def response_table(
    cells: Cells,
    factors: Sequence[Factor],
    levels: Mapping[str, float],
    steps: int = STEPS,
) -> pd.DataFrame:
    """Response of every cell along each factor, the others held.

    Parameters
    ----------
    cells : iterable of (key, surrogate)
    factors : sequence of Factor
    levels : mapping
        Coded levels at which the others are held.
    steps : int
        Levels a factor, evenly over its simulated range.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``factor``, ``coded``, ``natural``, ``y``, and ``low``,
        ``high``, which hold the value of a new run with a probability of 95 % (NaN without residual degrees
        of freedom).
    """
    line = np.linspace(CODED_LOW, CODED_HIGH, steps)
    parts = []
    for key, surrogate in cells:
        for factor in factors:
            z = hold_levels(surrogate.names, levels, {factor.name: line})
            low, high = surrogate.prediction_interval(z)
            columns = {"coded": line, "natural": factor.to_natural(line), "y": surrogate.predict(z)}
            parts.append(((*key[:4], factor.name), columns | {"low": low, "high": high}))
    return _join(parts)


def simulated_table(
    cells: Cells, test_quantities: pd.DataFrame, factors: Sequence[Factor], levels: Mapping[str, float]
) -> pd.DataFrame:
    """Simulated runs of every cell along each factor, with and without the influence of other factors.

    Parameters
    ----------
    cells : iterable of (key, surrogate)
    test_quantities : DataFrame
    factors : sequence of Factor
    levels : mapping
        Coded levels of the other factors after their influence is removed.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``factor``, ``set``, ``point``, ``natural``, ``y``,
        ``y_held``: y less what the surrogate gives to the other factors' distance from `levels`. Failed runs
        are left out.
    """
    runs = dict(iter(test_quantities.dropna(subset=["y"]).groupby(CELL, sort=True, observed=True)))
    parts = []
    for key, surrogate in cells:
        if key not in runs:
            continue
        own = runs[key].sort_values(["set", "point"])
        z = own[list(surrogate.names)].to_numpy(dtype=float)
        y = own["y"].to_numpy(dtype=float)
        left = y - surrogate.predict(z)
        for factor in factors:
            k = surrogate.names.index(factor.name)
            held = hold_levels(surrogate.names, levels, {factor.name: z[:, k]})
            columns = {
                "set": own["set"].to_numpy(),
                "point": own["point"].to_numpy(),
                "natural": factor.to_natural(z[:, k]),
                "y": y,
                "y_held": surrogate.predict(held) + left,
            }
            parts.append(((*key[:4], factor.name), columns))
    return _join(parts)


def _join(parts: Sequence[tuple[Sequence[object], Mapping[str, np.ndarray]]]) -> pd.DataFrame:
    """One table of parts, each with its cell and factor; by column: a frame for each part takes seconds."""
    keys = pd.DataFrame([key for key, _ in parts], columns=[*CELL, "factor"])
    counts = [len(next(iter(own.values()))) for _, own in parts]
    columns = {name: np.concatenate([own[name] for _, own in parts]) for name in parts[0][1]}
    return keys.loc[keys.index.repeat(counts)].reset_index(drop=True).assign(**columns)


Array = NDArray[np.float64]
FALSE_ALARMS = (
    0.0005, 0.001, 0.002, 0.003, 0.005, 0.007, 0.01, 0.015, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5,
)  # fmt: skip


def pick_levels(grid: Array, most: int) -> Array:
    """At most `most` values of a grid, evenly spread over it, the last value among them."""
    place = np.unique(np.linspace(0, len(grid) - 1, most + 1).round().astype(int)[1:])
    return np.asarray(grid, dtype=float)[place]


def detection_table(
    cells: Cells,
    levels: Mapping[str, float],
    factors: Sequence[str],
    deltas: Array,
    sigmas: Array,
    f0: float = -2.0,
    false_alarms: Sequence[float] = FALSE_ALARMS,
) -> pd.DataFrame:
    """ROC of every cell: threshold and P_d at several P_f, changes of the fault and variations of a factor.

    Parameters
    ----------
    cells : iterable of (key, surrogate)
    levels : mapping
        Coded nominal levels, where the nuisances are held.
    factors : sequence of str
        Nuisances that vary, one at a time.
    deltas : array (J,)
        Changes of the fault, coded.
    sigmas : array (S,)
        Standard deviations of the factor that varies, coded.
    f0 : float
        Coded fault level of H0.
    false_alarms : sequence of float

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``factor``, ``sigma``, ``delta``, ``p_f``, ``threshold``,
        ``p_d``. A detector that always says the same has no threshold (NaN) and detects nothing.
    """
    wanted = np.asarray(sorted(set(false_alarms)), dtype=float)
    deltas, sigmas = np.asarray(deltas, dtype=float), np.asarray(sigmas, dtype=float)
    shape = (len(sigmas), len(deltas), len(wanted))
    grids = np.broadcast_arrays(sigmas[:, None, None], deltas[None, :, None], wanted[None, None, :])
    parts = []
    for key, surrogate in cells:
        for factor in factors:
            h, p_d = _detect(surrogate, factor, levels, f0, deltas, sigmas, wanted)
            table = {
                **dict(zip(CELL, key, strict=False)),
                "factor": factor,
                **{name: grid.ravel() for name, grid in zip(("sigma", "delta", "p_f"), grids, strict=True)},
                "threshold": np.broadcast_to(h[:, None, :], shape).ravel(),
                "p_d": p_d.ravel(),
            }
            parts.append(pd.DataFrame(table))
    return pd.concat(parts, ignore_index=True)


def _detect(
    surrogate: ChosenSurrogate | Surrogate,
    factor: str,
    levels: Mapping[str, float],
    f0: float,
    deltas: Array,
    sigmas: Array,
    wanted: Array,
) -> tuple[Array, Array]:
    """Thresholds (S, P) and P_d (S, J, P)."""
    if surrogate.status == "constant":
        empty = np.full((len(sigmas), len(wanted)), np.nan)
        return empty, np.zeros((len(sigmas), len(deltas), len(wanted)))
    if isinstance(surrogate, ChosenSurrogate):
        return _detect_tabulated(Tabulated(surrogate, factor, levels, deltas, f0), sigmas, wanted)
    null, alternatives = scope_quadratics(surrogate, factor, deltas, sigmas, f0, levels)
    h = alarm_threshold(null[:, None, :], wanted)
    return h, tail_probability(alternatives[:, :, None, :], h[:, None, :])


def _detect_tabulated(table: Tabulated, sigmas: Array, wanted: Array) -> tuple[Array, Array]:
    mean = table.mean
    h = np.empty((len(sigmas), len(wanted)))
    p_d = np.empty((len(sigmas), len(mean) - 1, len(wanted)))
    for s, sigma in enumerate(sigmas):
        left, share = interpolation(table.nodes, table.centre + sigma * SPREAD)
        y = mean[:, left] + share * (mean[:, left + 1] - mean[:, left])
        order = np.argsort(-y[0], kind="stable")
        for p, one in enumerate(wanted):
            h[s, p] = weighted_threshold(y[0], order, WEIGHTS, one)
            p_d[s, :, p] = (y[1:] >= h[s, p]) @ WEIGHTS
    return h, p_d


def largest_passing(passes: NDArray[np.bool_], sigmas: Array) -> Array:
    """Largest sigma up to which all sigmas pass, shape (...) from passes (..., S); 0 if the first fails."""
    reached = np.where(passes.all(axis=-1), passes.shape[-1], np.argmin(passes, axis=-1))
    return np.concatenate([[0.0], sigmas])[reached]


def sampled_tolerance(
    surrogate: ChosenSurrogate,
    factor: str,
    levels: Mapping[str, float],
    deltas: Array,
    sigmas: Array,
    rng: np.random.Generator,
    draws: int,
    f0: float = -2.0,
    false_alarm: float = 0.01,
    detection: float = 0.99,
) -> tuple[Array, Array]:
    """Largest standard deviation of a nuisance that a cell bears, coded.

    Parameters
    ----------
    surrogate : ChosenSurrogate
    factor : str
        The nuisance that varies about its nominal level; the others are held.
    levels : mapping
        Coded nominal levels.
    deltas, sigmas : array (J,), (S,)
    rng : numpy.random.Generator
    draws : int
        Response functions.
    f0, false_alarm, detection : float
        As in `wearscope.evaluation.scope.scope_table`.

    Returns
    -------
    value : array (J,)
        Of the mean response; at most the last sigma.
    drawn : array (draws, J)
    """
    if surrogate.status == "constant":
        return np.zeros(len(deltas)), np.zeros((draws, len(deltas)))
    table = Tabulated(surrogate, factor, levels, deltas, f0)
    value = tabulated_scope(table.mean, table.nodes, sigmas, false_alarm, table.centre) >= detection
    passes = table.drawn_passes(sigmas, rng, draws, false_alarm, detection)
    return largest_passing(value.T, sigmas), largest_passing(np.swapaxes(passes, 1, 2), sigmas)
