"""Groups over robot, cycle, axis and detector, and the intervals stated with them.

Detectors are compared over the cells that they share, with bootstrap intervals.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from wearscope.errors import InputError
from wearscope.surrogates.fitting import CELL


def check_group(by: Sequence[str]) -> list[str]:
    """Refuse a grouping over anything but the design parameters.

    Raises
    ------
    InputError
        Where a name is not robot, cycle, axis or fda, or repeats.
    """
    wrong = [name for name in by if name not in CELL]
    if wrong:
        raise InputError(
            f"grouping: '{wrong[0]}' is no design parameter; group by some of {', '.join(CELL)}."
        )
    if len(set(by)) != len(by):
        raise InputError("grouping: a design parameter is named twice; name it once.")
    return list(by)


def groups_of(table: pd.DataFrame, by: Sequence[str]) -> Iterator[tuple[tuple, pd.DataFrame]]:
    """Groups of a table in sorted order; all rows are one group, keyed ``()``, where `by` is empty."""
    by = check_group(by)
    if not by:
        yield (), table
    else:
        yield from table.groupby(by, sort=True, observed=True)


def wilson_interval(successes: int, trials: int, level: float = 0.95) -> tuple[float, float]:
    """Wilson score interval of a share; NaN without trials.

    References
    ----------
    Wilson, E. B. (1927). Probable inference, the law of succession, and statistical inference.
    """
    if trials == 0:
        return float("nan"), float("nan")
    from scipy.stats import binomtest  # here, because importing it takes a second

    low, high = binomtest(successes, trials).proportion_ci(level, "wilson")
    return float(low), float(high)


def box_statistics(values: ArrayLike) -> dict[str, float]:
    """Median, quartiles and whiskers (last value within 1.5 interquartile ranges); NaN left out, counted.

    Parameters
    ----------
    values : array (N,)

    Returns
    -------
    dict
        ``n``, ``n_nan``, ``median``, ``q1``, ``q3``, ``whisker_low``, ``whisker_high``, ``n_outliers``.
    """
    values = np.asarray(values, dtype=float)
    good = values[np.isfinite(values)]
    result: dict[str, float] = {"n": good.size, "n_nan": values.size - good.size}
    if good.size == 0:
        names = ("median", "q1", "q3", "whisker_low", "whisker_high")
        return result | dict.fromkeys(names, np.nan) | {"n_outliers": 0}
    q1, median, q3 = np.percentile(good, [25, 50, 75])
    inside = good[(good >= q1 - 1.5 * (q3 - q1)) & (good <= q3 + 1.5 * (q3 - q1))]
    return result | {
        "median": float(median),
        "q1": float(q1),
        "q3": float(q3),
        "whisker_low": float(inside.min()),
        "whisker_high": float(inside.max()),
        "n_outliers": int(good.size - inside.size),
    }


def bootstrap_indices(n: int, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Resampled positions, shape (draws, n)."""
    return rng.integers(0, n, size=(draws, n))


Array = NDArray[np.float64]

CELL_OF_DETECTOR = ["robot", "cycle", "axis"]
FEWEST = 5
"""Cells below which no interval is stated: a resample of fewer says nothing."""
DRAWS = 2000


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval over the choice of cells.

    Attributes
    ----------
    value, low, high : float
        NaN where unknown; the interval also where fewer than `FEWEST` cells have the number.
    n : int
        Cells that it rests on.
    """

    value: float
    low: float
    high: float
    n: int

    def above(self, threshold: float) -> bool | None:
        """Whether it is larger than a threshold; None where the interval leaves that open."""
        if np.isnan(self.low) or np.isnan(self.high) or self.low <= threshold <= self.high:
            return None
        return bool(self.low > threshold)

    def below(self, threshold: float) -> bool | None:
        """Whether it is smaller than a threshold; None where the interval leaves that open."""
        larger = self.above(threshold)
        return None if larger is None else not larger


def pivot_detectors(table: pd.DataFrame, value: str) -> pd.DataFrame:
    """Matrix of a column: robot, test-cycle and axis down, detectors across."""
    wide = table.pivot(index=CELL_OF_DETECTOR, columns="fda", values=value)
    return wide.sort_index(axis=0).sort_index(axis=1).astype(float)


def nan_median(values: Array) -> Array:
    """Median over the last axis but one without NaN; NaN where all values are NaN; infinities count."""
    ordered = np.sort(values, axis=-2)  # NaN last
    count = np.sum(~np.isnan(values), axis=-2, keepdims=True)
    lower, upper = (
        np.take_along_axis(ordered, np.maximum(place, 0), axis=-2) for place in ((count - 1) // 2, count // 2)
    )
    middle = np.where(lower == upper, lower, lower + 0.5 * (upper - lower))
    return np.where(count > 0, middle, np.nan)[..., 0, :]


def nan_mean(values: Array) -> Array:
    """Mean over the last axis but one without NaN; NaN where all values are NaN."""
    count = np.sum(~np.isnan(values), axis=-2)
    total = np.sum(np.where(np.isnan(values), 0.0, values), axis=-2)
    return np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)


def estimate_columns(
    wide: pd.DataFrame, statistic: Callable[[Array], Array] = nan_median
) -> dict[str, Estimate]:
    """Statistic of each detector's column, with its interval."""
    values = wide.to_numpy(dtype=float)
    value, boot = statistic(values), _resample(values, statistic)
    counts = (~np.isnan(values)).sum(axis=0)
    return {
        str(name): _estimate(float(value[k]), boot[:, k], int(counts[k]))
        for k, name in enumerate(wide.columns)
    }


def estimate_difference(
    wide: pd.DataFrame,
    first: str,
    second: str,
    statistic: Callable[[Array], Array] = nan_median,
) -> Estimate:
    """Statistic of `first` less that of `second`, resampling the cells that both have together."""
    pair = wide[[first, second]].dropna()
    values = pair.to_numpy(dtype=float)
    if not len(values):
        return Estimate(np.nan, np.nan, np.nan, 0)
    value, boot = statistic(values), _resample(values, statistic)
    with np.errstate(invalid="ignore"):
        return _estimate(float(value[0] - value[1]), boot[:, 0] - boot[:, 1], len(values))


def _resample(values: Array, statistic: Callable[[Array], Array]) -> Array:
    """Statistic of resampled rows, (`DRAWS`, columns); the draws depend on the number of rows only."""
    n = len(values)
    rng = np.random.default_rng(np.random.SeedSequence([n, 29]))
    return statistic(values[bootstrap_indices(n, DRAWS, rng)])


def _estimate(value: float, boot: Array, n: int) -> Estimate:
    good = boot[~np.isnan(boot)]
    if n < FEWEST or not good.size:
        return Estimate(value, np.nan, np.nan, n)
    low, high = np.quantile(good, [0.025, 0.975], method="nearest")
    return Estimate(value, float(low), float(high), n)


def decide(outcomes: Sequence[bool | None]) -> str:
    """A claim's verdict from its parts: agrees, disagrees, partly, undecided; not asked without parts.

    Parts that the intervals leave open make it undecided, unless some part is refuted.
    """
    if not outcomes:
        return "not asked"
    if all(outcomes):
        return "agrees"
    if any(one is False for one in outcomes):
        return "partly" if any(outcomes) else "disagrees"
    return "undecided"
