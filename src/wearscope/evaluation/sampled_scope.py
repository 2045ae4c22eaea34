"""Scope matrices (12) to (16), ROC and tolerance of every cell, from its response along one nuisance factor.

A quadratic surrogate has a closed form. A chosen surrogate has none, so its response is tabulated and
integrated numerically. From either follow the alarm threshold (13), the detection probability (14) and the
ROC. The tolerance is the scope in one number: the largest variation of a nuisance at which a fault is still
detected.
"""

from collections.abc import Iterable, Mapping, Sequence

import numba
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from wearscope.designs.factors import CODED_HIGH, CODED_LOW, FAULT, PAPER_FACTORS, Factor, nominal_levels
from wearscope.designs.kinds import generator_for
from wearscope.errors import InputError
from wearscope.evaluation.scope import (
    alarm_threshold,
    along_operator,
    detection_probability,
    paper_grid,
    scope_quadratics,
    standardise,
    tail_probability,
)
from wearscope.evaluation.scope_kde import detection_probabilities, draw_runs
from wearscope.evaluation.snr import output_status
from wearscope.surrogates.chosen import CHOSEN, ChosenSurrogate
from wearscope.surrogates.fitting import CELL, Surrogate, cell_name, hold_levels

Array = NDArray[np.float64]
METHODS = ("exact", "kde")

#: Points of the standard normal distribution by which a nuisance is integrated; their spacing resolves the
#: tails of probability P_f' and 1 - P_d'.
SPREAD = np.linspace(-4.5, 4.5, 361)
#: Probability of each of these points.
WEIGHTS = np.diff(ndtr(np.concatenate([[-np.inf], 0.5 * (SPREAD[1:] + SPREAD[:-1]), [np.inf]])))
#: Number of tabulated levels of a nuisance on each side of its mean; number of fault levels at which response
#: functions are drawn.
STEPS = 16
#: Halvings of the range of values in the search for the largest ones.
BISECTIONS = 6
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
def weighted_threshold(values: Array, weights: Array, false_alarm: float) -> float:
    """Return the smallest threshold for which values at or above it have at most the weight `false_alarm`.

    The threshold is interpolated between the two values where the weight is exceeded; equal values are never
    split. Bisection first leaves out most of the other values, as sorting all would take most of the time.
    """
    low, high = values.min(), values.max()
    for _ in range(BISECTIONS):
        middle, above = 0.5 * (low + high), 0.0
        for k in range(len(values)):
            above += weights[k] if values[k] >= middle else 0.0
        if above > false_alarm:
            low = middle
        else:
            high = middle
    largest = np.flatnonzero(~(values < low))
    order, above = largest[np.argsort(-values[largest])], 0.0
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
def _detect_table(
    values: Array, left: NDArray[np.int64], share: Array, weights: Array, false_alarm: float
) -> tuple[Array, Array]:
    """Return thresholds (S,) and P_d (S, J) of responses (W, 1 + J); column 0 is H0, the others are H1."""
    null, thresholds = np.empty(len(weights)), np.empty(len(left))
    detected = np.zeros((len(left), values.shape[1] - 1))
    for s in range(len(left)):
        for k in range(len(weights)):
            i = left[s, k]
            null[k] = values[i, 0] + share[s, k] * (values[i + 1, 0] - values[i, 0])
        thresholds[s] = weighted_threshold(null, weights, false_alarm)
        for k in range(len(weights)):
            i, part, weight = left[s, k], share[s, k], weights[k]
            for j in range(1, values.shape[1]):
                y = values[i, j] + part * (values[i + 1, j] - values[i, j])
                detected[s, j - 1] += weight if y >= thresholds[s] else 0.0
    return thresholds, detected


def detect_tabulated(
    values: Array, nodes: Array, sigmas: Array, false_alarm: float = 0.01, centre: float = 0.0
) -> tuple[Array, Array]:
    """Compute threshold (13) and P_d (14) from responses along the nuisance, without sampling error.

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
    threshold : array (..., S)
    p_d : array (..., S, J)
    """
    left, share = interpolation(nodes, centre + sigmas[:, None] * SPREAD)
    tables = np.ascontiguousarray(np.swapaxes(values, -1, -2)).reshape(-1, *values.shape[:-3:-1])
    found = [_detect_table(table, left, share, WEIGHTS, false_alarm) for table in tables]
    shape = (*values.shape[:-2], len(sigmas))
    return np.array([h for h, _ in found]).reshape(shape), np.array([p for _, p in found]).reshape(*shape, -1)


class ClosedForm:
    """Response of a quadratic surrogate along one nuisance, with the other factors fixed.

    Parameters
    ----------
    surrogate, factor, levels, deltas, f0
        As those of `Tabulated`.
    """

    #: Name of the stream of random numbers for draws of the coefficients; number of draws.
    stream, draws = "scope confidence", 200

    def __init__(
        self, surrogate: Surrogate, factor: str, levels: Mapping[str, float], deltas: Array, f0: float
    ) -> None:
        self.surrogate, self.factor, self.levels = surrogate, factor, levels
        self.faults, self.status = f0 + np.concatenate([[0.0], deltas]), output_status(surrogate)
        parts = scope_quadratics(surrogate, factor, deltas, np.ones(1), f0, levels)
        self._rows = np.concatenate(parts, axis=1)[0]

    def detect(self, sigmas: Array, wanted: Array) -> tuple[Array, Array]:
        """Return thresholds (S, P) and P_d (S, J, P) at the wanted probabilities of false alarm (P,)."""
        rows = standardise(self._rows, sigmas[:, None])
        h = alarm_threshold(rows[:, :1], wanted)
        return h, tail_probability(rows[:, 1:, None], h[:, None])

    def respond(self, sigma: float, x: Array) -> Array:
        """Return the responses (1 + J, M) to standard normal values (M,) of the nuisance."""
        return standardise(self._rows, sigma) @ np.stack([np.ones_like(x), x, x * x])

    def find_confidence(
        self, sigmas: Array, rng: np.random.Generator, draws: int, false_alarm: float, detection: float
    ) -> Array:
        """Return the share (S, J) of coefficient draws for which a grid point meets (12).

        The share has a standard error of at most 0.5 / sqrt(draws). It is NaN without residual degrees of
        freedom or draws.
        """
        if self.surrogate.dof < 1 or draws < 1:
            return np.full((len(sigmas), len(self.faults) - 1), np.nan)
        theta = self.surrogate.draw_coefficients(rng, draws)
        maps = along_operator(self.surrogate, self.factor, self.levels, self.faults)
        along = np.einsum("dp,jpc->jdc", theta, maps)
        drawn = standardise(along, sigmas[:, None, None])
        return np.mean(detection_probability(drawn[:, :1], drawn[:, 1:], false_alarm) >= detection, axis=-1)


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

    #: Name of the stream of random numbers for drawn response functions; number of draws.
    stream, draws = "sampled scope", 60

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
        middle = self.mean[:, len(self.nodes) // 2]
        falls = surrogate.status == "ok" and middle[np.argmax(deltas) + 1] < middle[0]
        self.status = "decreasing" if falls else surrogate.status

    def _points(self, faults: Array) -> Array:
        """Return the coded points of the table at some fault levels."""
        return tabulated_points(self.surrogate.names, self.factor, faults, self.nodes, self.levels)

    def detect(self, sigmas: Array, wanted: Array) -> tuple[Array, Array]:
        """Return thresholds (S, P) and P_d (S, J, P) at the wanted probabilities of false alarm (P,)."""
        found = [detect_tabulated(self.mean, self.nodes, sigmas, one, self.centre) for one in wanted]
        return np.stack([h for h, _ in found], axis=-1), np.stack([p_d for _, p_d in found], axis=-1)

    def respond(self, sigma: float, x: Array) -> Array:
        """Return the responses (1 + J, M) to standard normal values (M,) of the nuisance."""
        left, share = interpolation(self.nodes, self.centre + sigma * x)
        return self.mean.take(left, axis=1) + share * np.diff(self.mean).take(left, axis=1)

    def find_confidence(
        self, sigmas: Array, rng: np.random.Generator, draws: int, false_alarm: float, detection: float
    ) -> Array:
        """Return the share (S, J) of drawn response functions for which a grid point meets (12)."""
        if draws < 1:
            return np.full((len(sigmas), len(self.faults) - 1), np.nan)
        return np.mean(self.drawn_passes(sigmas, rng, draws, false_alarm, detection), axis=0)

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
        _, p_d = detect_tabulated(self.mean + away, self.nodes, sigmas, false_alarm, self.centre)
        return p_d >= detection


#: Cells (robot, cycle, axis, fda), each with its surrogate.
Cells = Iterable[tuple[tuple, ChosenSurrogate | Surrogate]]


def respond_along(
    surrogate: ChosenSurrogate | Surrogate, factor: str, levels: Mapping[str, float], deltas: Array, f0: float
) -> ClosedForm | Tabulated:
    """Return a surrogate's response along a nuisance, with the parameters of `Tabulated`."""
    if isinstance(surrogate, ChosenSurrogate):
        return Tabulated(surrogate, factor, levels, deltas, f0)
    return ClosedForm(surrogate, factor, levels, deltas, f0)


def estimate_by_kernels(
    line: ClosedForm | Tabulated,
    sigmas: Array,
    false_alarm: float = 0.01,
    runs: int = 100_000,
    seed: int = 0,
) -> Array:
    """Compute P_d (14) on the grid by Monte Carlo and kernel density estimates.

    Parameters
    ----------
    line : ClosedForm or Tabulated
    sigmas : array (S,)
    false_alarm : float
    runs : int
        Number of draws for each sigma and hypothesis. All fault changes at one sigma share the draws of H1,
        and all cells and factors share all draws.
    seed : int

    Returns
    -------
    array (S, J)
    """
    result = np.empty((len(sigmas), len(line.faults) - 1))
    for s, sigma in enumerate(sigmas):
        x, weights0, weights1 = draw_runs(seed, s, runs)
        y = line.respond(sigma, x)
        result[s] = detection_probabilities(y[0], y[1:], weights0, weights1, runs, false_alarm)
    return result


def scope_table(
    cells: Cells,
    factors: Sequence[str] = ("w3", "w5"),
    levels: Mapping[str, float] | None = None,
    deltas: ArrayLike | None = None,
    sigmas: ArrayLike | None = None,
    f0: float = -2.0,
    methods: Sequence[str] = METHODS,
    false_alarm: float = 0.01,
    detection: float = 0.99,
    runs: int = 100_000,
    seed: int = 0,
    draws: int | None = None,
) -> pd.DataFrame:
    """Compute the scope matrices of every cell, in long form.

    The rows of a cell do not depend on the other cells, so that a study can be computed in parts. Levels of a
    nuisance at which a chosen surrogate is asked are clipped to -2..2, as nothing was simulated outside.

    Parameters
    ----------
    cells : iterable of (key, surrogate)
        From `wearscope.surrogates.fitting.surrogates_of`, whose keys name the model, or from
        `wearscope.surrogates.chosen.read_chosen`.
    factors : sequence of str
        Nuisances that vary, one at a time.
    levels : mapping, optional
        Coded levels at which the other nuisances are fixed; by default the nominal point (18). The varying
        one scatters about 0 for a quadratic surrogate, and about its level for a chosen one.
    deltas, sigmas : array_like (J,), (S,), optional
        Coded grid (16); by default `wearscope.evaluation.scope.paper_grid`.
    f0 : float
        Coded fault level of H0.
    methods : sequence of {"exact", "kde"}
        ``exact`` is the closed form or, for a chosen surrogate, numerical integration.
    false_alarm, detection : float
        P_f', P_d'.
    runs, seed
        See `estimate_by_kernels`.
    draws : int, optional
        Number of draws of a surrogate for ``confidence``, 0 for none; by default 200 of a quadratic one's
        coefficients, and 60 response functions of a chosen one.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``model``, ``factor``, ``delta``, ``sigma``, ``p_d``,
        ``passes``, ``method``, ``status``, ``confidence``. The status is ``ok``, ``constant`` (never passes)
        or ``decreasing``: the test quantity falls with wear (a quadratic surrogate has theta_0 < 0); it is
        still judged by rule (13), without reversing its sign. The confidence (NaN for kde) is the share of
        draws for which the grid point passes.

    Raises
    ------
    InputError
        Unknown factor or method, an empty grid, a non-positive sigma, probabilities out of order.
    """
    levels = nominal_levels(PAPER_FACTORS) if levels is None else levels
    changes, variations = (
        paper if given is None else np.asarray(given, dtype=float)
        for given, paper in zip((deltas, sigmas), paper_grid(), strict=True)
    )
    check_setting(changes, variations, methods, false_alarm, detection, runs)
    blocks = []
    for key, surrogate in cells:
        for factor in factors:
            if factor not in surrogate.names or factor == FAULT:
                raise InputError(f"scope: '{factor}' is no nuisance; use {', '.join(surrogate.names[1:])}.")
            line = respond_along(surrogate, factor, levels, changes, f0)
            for method in methods:
                sure = np.full((len(variations), len(changes)), np.nan)
                if line.status == "constant":
                    p_d = np.zeros(sure.shape)
                    sure = p_d if method == "exact" else sure
                elif method == "exact":
                    p_d = line.detect(variations, np.array([false_alarm]))[1][..., 0]
                    rng = generator_for(seed, line.stream, cell_name(key), factor)
                    count = line.draws if draws is None else draws
                    sure = line.find_confidence(variations, rng, count, false_alarm, detection)
                else:
                    p_d = estimate_by_kernels(line, variations, false_alarm, runs, seed)
                blocks.append(((*key, CHOSEN)[:5], factor, method, line.status, p_d, sure))
    return _lengthen(blocks, changes, variations, detection)


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


def _lengthen(blocks: list, deltas: np.ndarray, sigmas: np.ndarray, detection: float) -> pd.DataFrame:
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


RESPONSE_STEPS = 33


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
            line = respond_along(surrogate, factor, levels, deltas, f0)
            h, p_d = line.detect(sigmas, wanted)
            h = np.full_like(h, np.nan) if line.status == "constant" else h
            table = {
                **dict(zip(CELL, key, strict=False)),
                "factor": factor,
                **{name: grid.ravel() for name, grid in zip(("sigma", "delta", "p_f"), grids, strict=True)},
                "threshold": np.broadcast_to(h[:, None, :], shape).ravel(),
                "p_d": p_d.ravel(),
            }
            parts.append(pd.DataFrame(table))
    return pd.concat(parts, ignore_index=True)


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
        As in `scope_table`.

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
    value = table.detect(sigmas, np.array([false_alarm]))[1][..., 0] >= detection
    passes = table.drawn_passes(sigmas, rng, draws, false_alarm, detection)
    return largest_passing(value.T, sigmas), largest_passing(np.swapaxes(passes, 1, 2), sigmas)
