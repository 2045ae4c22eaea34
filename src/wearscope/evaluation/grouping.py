"""Groups over any subset of robot, cycle, axis and detector, and the intervals stated with them."""

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

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
