"""Scope matrices (12) to (16), ROC and tolerance of chosen surrogates, by numerical integration.

A chosen surrogate has no closed form, so its response along one nuisance factor is tabulated. From the table
follow the alarm threshold (13), the detection probability (14) and the ROC of every cell. The tolerance is
the scope in one number: the largest variation of a nuisance at which a fault is still detected.
"""

from collections.abc import Iterable, Mapping, Sequence

import numba
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtr

from wearscope.designs.factors import CODED_HIGH, CODED_LOW, FAULT, Factor
from wearscope.designs.kinds import generator_for
from wearscope.errors import InputError
from wearscope.evaluation.scope import (
    METHODS,
    alarm_threshold,
    check_setting,
    long_table,
    scope_quadratics,
    tail_probability,
)
from wearscope.evaluation.scope_kde import detection_probabilities, draw_runs
from wearscope.surrogates.chosen import CHOSEN, ChosenSurrogate
from wearscope.surrogates.fitting import CELL, Surrogate, cell_name, hold_levels

Array = NDArray[np.float64]

#: Points of the standard normal distribution by which a nuisance is integrated; their spacing resolves the
#: tails of probability P_f' and 1 - P_d'.
SPREAD = np.linspace(-4.5, 4.5, 361)
#: Probability of each of these points.
WEIGHTS = np.diff(ndtr(np.concatenate([[-np.inf], 0.5 * (SPREAD[1:] + SPREAD[:-1]), [np.inf]])))
#: Number of tabulated levels of a nuisance on each side of its mean; number of fault levels at which response
#: functions are drawn.
STEPS = 16
DRAWN_FAULTS = 11


def table_nodes(centre: float = 0.0) -> Array:
    """Return the coded levels (2 STEPS + 1,) of the varying nuisance; they are denser near its mean."""
    share = np.linspace(0.0, 1.0, STEPS + 1) ** 1.5
    low, high = centre + (CODED_LOW - centre) * share, centre + (CODED_HIGH - centre) * share
    return np.concatenate([low[:0:-1], high])


def tabulated_points(
    names: Sequence[str], factor: str, faults: Array, nodes: Array, levels: Mapping[str, float]
) -> Array:
    """Return coded points (J W, n): each fault level with each level of the nuisance, other factors fixed."""
    varied = {FAULT: np.repeat(faults, len(nodes)), factor: np.tile(nodes, len(faults))}
    return hold_levels(names, levels, varied)


def interpolation(nodes: Array, at: Array) -> tuple[NDArray[np.int64], Array]:
    """Return for each level the node to its left and the fraction of the way to the next node.

    Levels outside the range of `nodes` are clipped to it.
    """
    inside = np.clip(at, nodes[0], nodes[-1])
    left = np.clip(np.searchsorted(nodes, inside, side="right") - 1, 0, len(nodes) - 2)
    return left, (inside - nodes[left]) / (nodes[left + 1] - nodes[left])


@numba.njit(cache=True)
def weighted_threshold(values: Array, order: NDArray[np.int64], weights: Array, false_alarm: float) -> float:
    """Return the smallest threshold for which values at or above it have at most the weight `false_alarm`.

    The threshold is interpolated between the two values where the weight is exceeded; equal values are never
    split. `order` holds the indices of the values, the largest value first.
    """
    above = 0.0
    for place in range(len(order)):
        k = order[place]
        if above + weights[k] > false_alarm:
            if place == 0:
                return np.nextafter(values[k], np.inf)
            previous = values[order[place - 1]]
            if previous == values[k]:
                return np.nextafter(previous, np.inf)
            part = (false_alarm - above) / weights[k]
            return previous + part * (values[k] - previous)
        above += weights[k]
    return values[order[-1]]


@numba.njit(cache=True)
def _detect_tables(
    values: Array, left: NDArray[np.int64], share: Array, weights: Array, false_alarm: float, result: Array
) -> None:
    """Write P_d (S, J) of tabulated responses (1 + J, W) to `result`: row 0 is H0, the others are H1."""
    count = weights.size
    null = np.empty(count)
    for s in range(left.shape[0]):
        for k in range(count):
            i = left[s, k]
            null[k] = values[0, i] + share[s, k] * (values[0, i + 1] - values[0, i])
        h = weighted_threshold(null, np.argsort(-null), weights, false_alarm)
        for j in range(1, values.shape[0]):
            detected = 0.0
            for k in range(count):
                i = left[s, k]
                y = values[j, i] + share[s, k] * (values[j, i + 1] - values[j, i])
                if y >= h:
                    detected += weights[k]
            result[s, j - 1] = detected


def tabulated_scope(
    values: Array, nodes: Array, sigmas: Array, false_alarm: float = 0.01, centre: float = 0.0
) -> Array:
    """Compute P_d (14) on the grid from responses tabulated along the nuisance, without sampling error.

    Parameters
    ----------
    values : array (..., 1 + J, W)
        Responses: row 0 without the change of the fault, the others with each change.
    nodes : array (W,)
        Coded levels of the nuisance, rising; outside their range the response is that at the nearest end.
    sigmas : array (S,)
        Coded standard deviations of the nuisance.
    false_alarm : float
    centre : float
        Coded mean of the nuisance.

    Returns
    -------
    array (..., S, J)
    """
    left, share = interpolation(nodes, centre + sigmas[:, None] * SPREAD)
    tables = np.ascontiguousarray(values).reshape(-1, *values.shape[-2:])
    result = np.empty((len(tables), len(sigmas), values.shape[-2] - 1))
    for table, detected in zip(tables, result, strict=True):
        _detect_tables(table, left, share, WEIGHTS, false_alarm, detected)
    return result.reshape(*values.shape[:-2], *result.shape[1:])


def tabulated_kde(
    values: Array,
    nodes: Array,
    sigmas: Array,
    false_alarm: float,
    runs: int,
    seed: int,
    centre: float = 0.0,
) -> Array:
    """Compute P_d (S, J) of eq. (14) by Monte Carlo and kernel density estimates, as `kde_scope` does."""
    result = np.empty((len(sigmas), len(values) - 1))
    for s, sigma in enumerate(sigmas):
        at, weights0, weights1 = draw_runs(seed, s, runs)
        left, share = interpolation(nodes, centre + sigma * at)
        y = values[:, left] + share * (values[:, left + 1] - values[:, left])
        result[s] = detection_probabilities(y[0], y[1:], weights0, weights1, runs, false_alarm)
    return result


class Tabulated:
    """Tabulated mean response of a surrogate along one nuisance, with the other factors fixed.

    Parameters
    ----------
    surrogate : ChosenSurrogate
    factor : str
        Nuisance that varies about its nominal level.
    levels : mapping
        Coded nominal levels.
    deltas : array (J,)
        Coded changes of the fault.
    f0 : float
        Coded fault level of H0.

    Attributes
    ----------
    mean : array (1 + J, W)
        Mean response at the coded levels `nodes` (W,) of the nuisance, whose mean is `centre`; row 0 is H0.
    """

    def __init__(
        self,
        surrogate: ChosenSurrogate,
        factor: str,
        levels: Mapping[str, float],
        deltas: Array,
        f0: float,
    ) -> None:
        self.surrogate, self.factor, self.levels = surrogate, factor, levels
        self.centre = float(levels[factor])
        self.nodes, self.faults = table_nodes(self.centre), f0 + np.concatenate([[0.0], deltas])
        self.mean = surrogate.predict(self._points(self.faults)).reshape(len(self.faults), -1)

    def _points(self, faults: Array) -> Array:
        """Return the coded points of the table at some fault levels."""
        return tabulated_points(self.surrogate.names, self.factor, faults, self.nodes, self.levels)

    def drawn_passes(
        self, sigmas: Array, rng: np.random.Generator, draws: int, false_alarm: float, detection: float
    ) -> NDArray[np.bool_]:
        """Return whether grid points pass (draws, S, J), for response functions drawn from the surrogate.

        The difference of a drawn function to the mean response is smooth. So it is drawn at a few fault
        levels and interpolated between them.
        """
        coarse = np.linspace(self.faults.min(), self.faults.max(), DRAWN_FAULTS)
        z = self._points(coarse)
        shape = (draws, len(coarse), len(self.nodes))
        away = (self.surrogate.draw(z, rng, draws) - self.surrogate.predict(z)).reshape(shape)
        left, share = interpolation(coarse, self.faults)
        away = away[:, left] + share[:, None] * (away[:, left + 1] - away[:, left])
        return tabulated_scope(self.mean + away, self.nodes, sigmas, false_alarm, self.centre) >= detection


def sampled_scope_table(
    chosen: Iterable[tuple[tuple, ChosenSurrogate]],
    levels: Mapping[str, float],
    factors: Sequence[str],
    deltas: Array,
    sigmas: Array,
    f0: float = -2.0,
    methods: Sequence[str] = METHODS,
    false_alarm: float = 0.01,
    detection: float = 0.99,
    runs: int = 100_000,
    seed: int = 0,
    draws: int = 60,
) -> pd.DataFrame:
    """Compute the scope matrices of every cell's chosen surrogate, in long form.

    Nuisance levels are clipped to -2..2, as nothing was simulated outside that range.

    Parameters
    ----------
    chosen : iterable of (key, ChosenSurrogate)
    levels : mapping
        Coded nominal levels, at which the nuisances are fixed; the varying one scatters about its level.
    factors : sequence of str
    deltas, sigmas : array (J,), (S,)
    f0, methods, false_alarm, detection, runs, seed
        As in `wearscope.evaluation.scope.scope_table`.
    draws : int
        Number of response functions for ``confidence``.

    Returns
    -------
    DataFrame
        As `wearscope.evaluation.scope.scope_table`, with ``model`` ``chosen``; the method ``exact`` is
        numerical integration.

    Raises
    ------
    InputError
        As `wearscope.evaluation.scope.scope_table`.
    """
    deltas, sigmas = np.asarray(deltas, dtype=float), np.asarray(sigmas, dtype=float)
    check_setting(deltas, sigmas, methods, false_alarm, detection, runs)
    blocks = []
    for key, surrogate in chosen:
        names = surrogate.names
        for factor in factors:
            if factor not in names or factor == FAULT:
                raise InputError(f"scope: '{factor}' is no nuisance; use {', '.join(names[1:])}.")
            table = Tabulated(surrogate, factor, levels, deltas, f0)
            mean, nodes, centre = table.mean, table.nodes, table.centre
            middle = mean[:, len(nodes) // 2]
            if surrogate.status == "constant":
                status = "constant"
            else:
                status = "decreasing" if middle[np.argmax(deltas) + 1] < middle[0] else "ok"
            for method in methods:
                sure = np.full((len(sigmas), len(deltas)), np.nan)
                if status == "constant":
                    p_d = np.zeros(sure.shape)
                    sure = np.zeros(sure.shape) if method == "exact" else sure
                elif method == "exact":
                    p_d = tabulated_scope(mean, nodes, sigmas, false_alarm, centre)
                    if draws:
                        rng = generator_for(seed, "sampled scope", cell_name(key), factor)
                        sure = table.drawn_passes(sigmas, rng, draws, false_alarm, detection).mean(axis=0)
                else:
                    p_d = tabulated_kde(mean, nodes, sigmas, false_alarm, runs, seed, centre)
                blocks.append(((*key, CHOSEN), factor, method, status, p_d, sure))
    return long_table(blocks, deltas, sigmas, detection)


RESPONSE_STEPS = 33

#: Cells (robot, cycle, axis, fda), each with its surrogate.
Cells = Iterable[tuple[tuple, ChosenSurrogate | Surrogate]]


def response_table(
    cells: Cells,
    factors: Sequence[Factor],
    levels: Mapping[str, float],
    steps: int = RESPONSE_STEPS,
) -> pd.DataFrame:
    """Compute the response of every cell along each factor, with the other factors fixed.

    Parameters
    ----------
    cells : iterable of (key, surrogate)
    factors : sequence of Factor
    levels : mapping
        Coded levels at which the other factors are fixed.
    steps : int
        Number of levels of a factor, evenly spaced over its simulated range.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``factor``, ``coded``, ``natural``, ``y``, and the 95 %
        prediction interval ``low``, ``high`` of a new run (NaN without residual degrees of freedom).
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
    """Return every cell's simulated runs along each factor, with and without the other factors' influence.

    Parameters
    ----------
    cells : iterable of (key, surrogate)
    test_quantities : DataFrame
    factors : sequence of Factor
    levels : mapping
        Coded levels to which the other factors are moved.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``factor``, ``set``, ``point``, ``natural``, ``y``, and
        ``y_held``: y after the surrogate has moved the other factors to `levels`. Failed runs are left out.
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
    """Join parts, each with its cell and factor, to one table.

    They are joined column by column, as making a frame for each part takes seconds.
    """
    keys = pd.DataFrame([key for key, _ in parts], columns=[*CELL, "factor"])
    counts = [len(next(iter(own.values()))) for _, own in parts]
    columns = {name: np.concatenate([own[name] for _, own in parts]) for name in parts[0][1]}
    return keys.loc[keys.index.repeat(counts)].reset_index(drop=True).assign(**columns)


#: Probabilities of false alarm at which the ROC is tabulated.
FALSE_ALARMS = (
    0.0005, 0.001, 0.002, 0.003, 0.005, 0.007, 0.01, 0.015, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5,
)  # fmt: skip


def pick_levels(grid: Array, most: int) -> Array:
    """Pick at most `most` values of a grid, evenly spread over it and including the last value."""
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
    """Compute the ROC of every cell: threshold and P_d at several P_f, changes of the fault and variations.

    Parameters
    ----------
    cells : iterable of (key, surrogate)
    levels : mapping
        Coded nominal levels, at which the nuisances are fixed.
    factors : sequence of str
        Nuisances that vary, one at a time.
    deltas : array (J,)
        Coded changes of the fault.
    sigmas : array (S,)
        Coded standard deviations of the factor that varies.
    f0 : float
        Coded fault level of H0.
    false_alarms : sequence of float

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``factor``, ``sigma``, ``delta``, ``p_f``, ``threshold``,
        ``p_d``. A detector with a constant test quantity has no threshold (NaN) and a ``p_d`` of 0.
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
    """Return thresholds (S, P) and P_d (S, J, P) at the wanted probabilities of false alarm (P,)."""
    if surrogate.status == "constant":
        empty = np.full((len(sigmas), len(wanted)), np.nan)
        return empty, np.zeros((len(sigmas), len(deltas), len(wanted)))
    if isinstance(surrogate, ChosenSurrogate):
        return _detect_tabulated(Tabulated(surrogate, factor, levels, deltas, f0), sigmas, wanted)
    null, alternatives = scope_quadratics(surrogate, factor, deltas, sigmas, f0, levels)
    h = alarm_threshold(null[:, None, :], wanted)
    return h, tail_probability(alternatives[:, :, None, :], h[:, None, :])


def _detect_tabulated(table: Tabulated, sigmas: Array, wanted: Array) -> tuple[Array, Array]:
    """Return thresholds (S, P) and P_d (S, J, P) of a tabulated response."""
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
    """Return the largest sigma (...) up to which all sigmas pass (..., S); 0 where the first one fails."""
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
    """Find the largest coded standard deviation of a nuisance that a cell tolerates.

    Parameters
    ----------
    surrogate : ChosenSurrogate
    factor : str
        Nuisance that varies about its nominal level; the others are fixed.
    levels : mapping
        Coded nominal levels.
    deltas, sigmas : array (J,), (S,)
    rng : numpy.random.Generator
    draws : int
        Number of response functions that are drawn.
    f0, false_alarm, detection : float
        As in `wearscope.evaluation.scope.scope_table`.

    Returns
    -------
    value : array (J,)
        Tolerance by the mean response; at most the last sigma.
    drawn : array (draws, J)
        Tolerance by each drawn response function.
    """
    if surrogate.status == "constant":
        return np.zeros(len(deltas)), np.zeros((draws, len(deltas)))
    table = Tabulated(surrogate, factor, levels, deltas, f0)
    value = tabulated_scope(table.mean, table.nodes, sigmas, false_alarm, table.centre) >= detection
    passes = table.drawn_passes(sigmas, rng, draws, false_alarm, detection)
    return largest_passing(value.T, sigmas), largest_passing(np.swapaxes(passes, 1, 2), sigmas)
