"""Groups of cells, and statistics over them with confidence intervals.

Detectors are compared over the cells that they share; the intervals come from the bootstrap.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy
from numpy.typing import ArrayLike, NDArray

from wearscope.errors import InputError
from wearscope.surrogates.fitting import CELL


def check_group(by: Sequence[str]) -> list[str]:
    """Refuse a grouping by anything but the design parameters; return it as a list.

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
    """Yield key and rows of each group in sorted order; an empty `by` gives one group with the key ``()``."""
    by = check_group(by)
    if not by:
        yield (), table
    else:
        yield from table.groupby(by, sort=True, observed=True)


def wilson_interval(successes: int, trials: int, level: float = 0.95) -> tuple[float, float]:
    """Return the Wilson score interval of a share; NaN without trials.

    References
    ----------
    Wilson, E. B. (1927). Probable inference, the law of succession, and statistical inference.
    """
    if trials == 0:
        return float("nan"), float("nan")
    low, high = scipy.stats.binomtest(successes, trials).proportion_ci(level, "wilson")
    return float(low), float(high)


def box_statistics(values: ArrayLike) -> dict[str, float]:
    """Compute median, quartiles and whiskers of a box plot; NaN are left out and counted.

    A whisker ends at the last value within 1.5 interquartile ranges of the box.

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


def central_interval(values: ArrayLike, level: float = 0.95) -> tuple[float, float]:
    """Return the ends between which the middle share `level` of the finite values lies; NaN without any."""
    known = np.asarray(values, dtype=float)
    good = known[np.isfinite(known)]
    if not good.size:
        return np.nan, np.nan
    low, high = np.quantile(good, [0.5 - level / 2, 0.5 + level / 2])
    return float(low), float(high)


def bootstrap_indices(n: int, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Draw indices (draws, n) with replacement."""
    return rng.integers(0, n, size=(draws, n))


Array = NDArray[np.float64]

#: Columns that name a cell of a given detector.
CELL_OF_DETECTOR = ["robot", "cycle", "axis"]
FEWEST = 5
"""Fewest cells for a bootstrap interval: resampling fewer cells tells nothing."""
DRAWS = 2000


@dataclass(frozen=True)
class Estimate:
    """A statistic over cells with its 95 % bootstrap interval.

    Attributes
    ----------
    value, low, high : float
        Value and interval; NaN where unknown. The interval is NaN also where fewer than `FEWEST` cells have a
        value.
    n : int
        Number of cells with a value.
    """

    value: float
    low: float
    high: float
    n: int

    def above(self, threshold: float) -> bool | None:
        """Return whether the interval lies above a threshold; None where it contains it or is NaN."""
        if np.isnan(self.low) or np.isnan(self.high) or self.low <= threshold <= self.high:
            return None
        return bool(self.low > threshold)

    def below(self, threshold: float) -> bool | None:
        """Return whether the interval lies below a threshold; None where it contains it or is NaN."""
        larger = self.above(threshold)
        return None if larger is None else not larger


def pivot_detectors(table: pd.DataFrame, value: str) -> pd.DataFrame:
    """Return a column as a matrix: rows are robot, test-cycle and axis; columns are detectors."""
    wide = table.pivot(index=CELL_OF_DETECTOR, columns="fda", values=value)
    return wide.sort_index(axis=0).sort_index(axis=1).astype(float)


def nan_median(values: Array) -> Array:
    """Return the median over the second-last axis; NaN are left out, infinite values count."""
    ordered = np.sort(values, axis=-2)  # NaN last
    count = np.sum(~np.isnan(values), axis=-2, keepdims=True)
    lower, upper = (
        np.take_along_axis(ordered, np.maximum(place, 0), axis=-2) for place in ((count - 1) // 2, count // 2)
    )
    middle = np.where(lower == upper, lower, lower + 0.5 * (upper - lower))
    return np.where(count > 0, middle, np.nan)[..., 0, :]


def nan_mean(values: Array) -> Array:
    """Return the mean over the second-last axis; NaN are left out, and it is NaN where all values are."""
    count = np.sum(~np.isnan(values), axis=-2)
    total = np.sum(np.where(np.isnan(values), 0.0, values), axis=-2)
    return np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)


def estimate_columns(
    wide: pd.DataFrame, statistic: Callable[[Array], Array] = nan_median
) -> dict[str, Estimate]:
    """Estimate a statistic of each detector's column, with its interval."""
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
    """Estimate the statistic of `first` minus that of `second`, over the cells that both have.

    Both are resampled with the same cells, so that the difference is paired.
    """
    pair = wide[[first, second]].dropna()
    values = pair.to_numpy(dtype=float)
    if not len(values):
        return Estimate(np.nan, np.nan, np.nan, 0)
    value, boot = statistic(values), _resample(values, statistic)
    with np.errstate(invalid="ignore"):
        return _estimate(float(value[0] - value[1]), boot[:, 0] - boot[:, 1], len(values))


def _resample(values: Array, statistic: Callable[[Array], Array]) -> Array:
    """Return the statistic of resampled rows (`DRAWS`, columns); the draws depend on the row count alone."""
    n = len(values)
    rng = np.random.default_rng(np.random.SeedSequence([n, 29]))
    return statistic(values[bootstrap_indices(n, DRAWS, rng)])


def _estimate(value: float, boot: Array, n: int) -> Estimate:
    """Return a value with the 95 % interval of its bootstrap values."""
    good = boot[~np.isnan(boot)]
    if n < FEWEST or not good.size:
        return Estimate(value, np.nan, np.nan, n)
    low, high = np.quantile(good, [0.025, 0.975], method="nearest")
    return Estimate(value, float(low), float(high), n)


def decide(outcomes: Sequence[bool | None]) -> str:
    """Decide a claim from its parts, each true, false or open (None).

    Returns ``agrees`` where all parts are true. Where a part is false, it returns ``partly`` if another is
    true, else ``disagrees``. It returns ``undecided`` where parts are open and none is false, and ``not
    asked`` without parts.
    """
    if not outcomes:
        return "not asked"
    if all(outcomes):
        return "agrees"
    if any(one is False for one in outcomes):
        return "partly" if any(outcomes) else "disagrees"
    return "undecided"
