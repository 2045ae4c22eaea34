"""Detection probabilities by Monte Carlo and a Gaussian kernel density estimate, as in the paper.

The runs of one sigma and hypothesis are drawn once for all cells and factors (common random numbers), so that
detectors do not differ by chance. A run is a value x of the standard normal variable that drives the
nuisance. The runs are binned linearly in x, and each bin counts as one weighted run. The tail of the kernel
density estimate is then a sum of normal tails, without a grid in y.
"""

import math
from functools import lru_cache

import numba
import numpy as np
from numpy.typing import NDArray

from wearscope.designs.kinds import generator_for

Array = NDArray[np.float64]
NODES = 2048  # number of bins


@numba.njit(cache=True)
def _bin_runs(x: Array, nodes: int, low: float, step: float) -> Array:
    """Return the weights (nodes,) of runs that are binned linearly onto low + k step; they add up to 1."""
    weights = np.zeros(nodes)
    for value in x:
        place = (value - low) / step
        k = math.floor(place)
        if k < 0:
            weights[0] += 1.0
        elif k >= nodes - 1:
            weights[nodes - 1] += 1.0
        else:
            share = place - k
            weights[k] += 1.0 - share
            weights[k + 1] += share
    return weights / x.size


def bin_runs(runs0: Array, runs1: Array) -> tuple[Array, Array, Array]:
    """Return nodes (M,), and the weights (M,) at these nodes of standard normal runs of H0 and of H1."""
    low = min(runs0.min(), runs1.min())
    step = (max(runs0.max(), runs1.max()) - low) / (NODES - 1)
    weights0, weights1 = (_bin_runs(runs, NODES, low, step) for runs in (runs0, runs1))
    return low + step * np.arange(NODES), weights0, weights1


@lru_cache(maxsize=256)
def draw_runs(seed: int, row: int, runs: int) -> tuple[Array, Array, Array]:
    """Draw the runs of one row of the grid, binned as `bin_runs` does."""
    rng = generator_for(seed, "scope", row)
    return bin_runs(rng.standard_normal(runs), rng.standard_normal(runs))


@numba.njit(cache=True)
def _tail(y: Array, weights: Array, bandwidth: float, h: float, enough: float) -> float:
    """Return the tail above h of the kernel density estimate of weighted runs; it stops beyond `enough`."""
    total = 0.0
    for k in range(y.size):
        if total > enough:
            break
        place = (y[k] - h) / bandwidth
        if place > 8.0:
            total += weights[k]
        elif place > -8.0:
            total += weights[k] * 0.5 * math.erfc(-place * 0.7071067811865476)
    return total


@numba.njit(cache=True)
def _deviation(y: Array, weights: Array) -> float:
    """Return the standard deviation of weighted values."""
    mean = 0.0
    for k in range(y.size):
        mean += weights[k] * y[k]
    variance = 0.0
    for k in range(y.size):
        variance += weights[k] * (y[k] - mean) ** 2
    return math.sqrt(variance)


@numba.njit(cache=True)
def _threshold(y: Array, weights: Array, bandwidth: float, probability: float) -> float:
    """Find the smallest h with a tail of at most `probability` by bisection."""
    low = y.min() - 9.0 * bandwidth
    high = y.max() + 9.0 * bandwidth
    for _ in range(60):
        middle = 0.5 * (low + high)
        if middle <= low or middle >= high:
            break
        if _tail(y, weights, bandwidth, middle, probability) > probability:
            low = middle
        else:
            high = middle
    return high


@numba.njit(cache=True)
def _detect(
    null: Array,
    alternatives: Array,
    weights0: Array,
    weights1: Array,
    factor: float,
    probability: float,
    scale: float,
    result: Array,
) -> None:
    """Write P_d (J,) to `result`, from responses at binned runs under H0 (M,) and under each H1 (J, M).

    `factor` is the bandwidth over the standard deviation. A response whose standard deviation is at most
    `scale` counts as constant.
    """
    deviation = _deviation(null, weights0)
    if deviation <= scale:
        h = null[0] + scale
    else:
        h = _threshold(null, weights0, factor * deviation, probability)
    for j in range(alternatives.shape[0]):
        y = alternatives[j]
        deviation = _deviation(y, weights1)
        if deviation <= scale:
            result[j] = 1.0 if y[0] >= h else 0.0
        else:
            result[j] = _tail(y, weights1, factor * deviation, h, np.inf)


def bandwidth_factor(runs: int) -> float:
    """Return Silverman's bandwidth over the standard deviation, which is optimal for a normal density."""
    return (4.0 / 3.0) ** 0.2 * runs ** (-0.2)


def detection_probabilities(
    null: Array,
    alternatives: Array,
    weights0: Array,
    weights1: Array,
    runs: int,
    false_alarm: float = 0.01,
) -> Array:
    """Compute P_d (14) at the threshold for P_f' from kernel density estimates of Monte Carlo runs.

    Parameters
    ----------
    null : array (M,)
        Responses at the nodes of `bin_runs` under H0.
    alternatives : array (J, M)
        The same under H1, for each fault change.
    weights0, weights1 : array (M,)
    runs : int
        Number of runs that were binned.
    false_alarm : float
        P_f'.

    Returns
    -------
    array (J,)
        P_d for each fault change. A response whose variation is only rounding counts as constant.
    """
    result = np.empty(len(alternatives))
    scale = 1e-12 * float(np.abs(null).max())
    _detect(
        np.ascontiguousarray(null), np.ascontiguousarray(alternatives), weights0, weights1,
        bandwidth_factor(runs), false_alarm, scale, result,
    )  # fmt: skip
    return result
