"""A shift of level at a moment of a run, of about the noise's size or above.

Noise with a memory wanders, and the best placed step holds much of it. A shift is told by its one moment:
with the residual made white by an autoregression, a step is a lone pulse, which wandering does not have (Tsay
1988, Journal of Forecasting 7: level shifts in time series). A line that bends models what drifts.
"""

from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.selection.series import average, bend_line, cut_knocks, find_whitening, leave

#: Rows that are looked at at most, of so many averaged at least (the common filter makes a step that long);
#: fewest before that; rows of the shorter side of a shift.
_MOST_ROWS, _FEWEST, _LEAST_ROWS, _SHORTEST = 200, 3, 100, 5
#: Bends of the lines that a shift is compared with.
_BENDS = (1, 4)
#: Rows about the best placed step in the residual itself at which it is looked for in the whitened one.
_NEAR = 4


@dataclass(frozen=True)
class Shift:
    """A step of a residual at its best moment.

    Attributes
    ----------
    deviance : float
        By which it fits better than a level, and than a line that bends: twice the log-likelihood ratio,
        negative where a line fits better.
    share : float
        Of the residual's variance that it holds.
    time : float
        [s]
    size : float
    """

    deviance: float
    share: float
    time: float
    size: float


def fit_shift(t: np.ndarray, x: np.ndarray) -> Shift | None:
    """The shift of level that fits a residual best; None where there is too little of it.

    Parameters
    ----------
    t : ndarray (M,)
        Times of the rows that count [s].
    x : ndarray (M,)
        Residual there.
    """
    if len(x) < _LEAST_ROWS or not np.ptp(x) > 0.0:
        return None
    every = max(_FEWEST, len(x) // _MOST_ROWS)
    t, x = average(every, t, x)
    x = cut_knocks(x)
    if not np.ptp(x) > 0.0:
        return None
    place, step, share = _place_step(x)
    whiten = find_whitening(x - step)
    after, level = np.arange(len(x)), np.ones(len(x))
    first, last = max(place - _NEAR, _SHORTEST), min(place + _NEAR, len(x) - _SHORTEST)
    own, place = min(
        (leave(np.column_stack([level, after >= k]), x, whiten), k) for k in range(first, last + 1)
    )
    others = [leave(one, x, whiten) for one in (level, *(bend_line(len(x), bends) for bends in _BENDS))]
    variance = max(own / (len(x) - len(whiten) - 1), 1e-300)
    size = float(x[place:].mean() - x[:place].mean())
    return Shift((min(others) - own) / variance, share, float(t[place - 1 : place + 1].mean()), size)


def _place_step(x: np.ndarray) -> tuple[int, np.ndarray, float]:
    """Row of the step that leaves least of a residual (M,), the step (M,), and its share of the variance."""
    k = np.arange(_SHORTEST, len(x) - _SHORTEST + 1)
    before = np.cumsum(x)[k - 1]
    low, high = before / k, (x.sum() - before) / (len(x) - k)
    gain = (high - low) ** 2 * k * (len(x) - k) / len(x)
    best = int(np.argmax(gain))
    step = np.where(np.arange(len(x)) < k[best], low[best], high[best])
    return int(k[best]), step, float(gain[best] / np.sum((x - x.mean()) ** 2))
