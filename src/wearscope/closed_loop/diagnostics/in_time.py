"""Tests of residuals over time: a shift of the level, and a spectral line that all runs share.

Autocorrelated noise wanders, so that the best placed step, or the best sine, explains much of it. Both are
therefore tested on the residual whitened by an autoregression, where a step is a single pulse (Tsay 1988,
Journal of Forecasting 7: level shifts in time series). A step must also fit better than a bent line, which
models a drift.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from wearscope.closed_loop.inference.series import average, bend_line, cut_knocks, find_whitening, leave

#: Fewest rows for a test; longer residuals are averaged to about so many rows, for a shift of level and for a
#: spectral line.
_FEWEST, _SHIFT_ROWS, _LINE_ROWS = 100, 200, 600
#: Shortest level [rows]; number of places, or frequencies, that are tried around the best one.
_SHORTEST, _NEAR = 5, 4
#: Numbers of bends of the piecewise linear functions that a shift is compared with.
_BENDS = (1, 4)
#: Fewest periods of a line in the longest run, and highest frequency [1/row].
_PERIODS, _HIGHEST = 2.5, 0.25
#: Number of frequencies whose waves are made at once.
_AT_ONCE = 256


@dataclass(frozen=True)
class Shift:
    """A step of a residual at its best moment.

    Attributes
    ----------
    deviance : float
        Twice its log-likelihood ratio against the best of a constant level and bent lines; negative where one
        of these fits better.
    share : float
        Share of the residual's variance that it explains.
    time : float
        Time of the step [s].
    size : float
        Change of the level, in the residual's unit.
    """

    deviance: float
    share: float
    time: float
    size: float


def fit_shift(t: np.ndarray, x: np.ndarray) -> Shift | None:
    """The shift of level that fits a residual best; None where it has too few rows.

    Parameters
    ----------
    t : ndarray (M,)
        Times of the rows that count [s].
    x : ndarray (M,)
        Residual there.
    """
    if len(x) < _FEWEST or not np.ptp(x) > 0.0:
        return None
    # The common filter spreads a step over three rows.
    t, x = average(max(3, len(x) // _SHIFT_ROWS), t, x)
    x = cut_knocks(x)
    if not np.ptp(x) > 0.0:
        return None
    rows = np.arange(len(x))
    k = rows[_SHORTEST : len(x) - _SHORTEST + 1]
    before = np.cumsum(x)[k - 1]
    low, high = before / k, (x.sum() - before) / (len(x) - k)
    gain = (high - low) ** 2 * k * (len(x) - k) / len(x)
    best = int(np.argmax(gain))
    whiten = find_whitening(x - np.where(rows < k[best], low[best], high[best]))
    level = np.ones(len(x))
    near = k[max(best - _NEAR, 0) : best + _NEAR + 1]
    own, place = min((leave(np.column_stack([level, rows >= at]), x, whiten), at) for at in near)
    others = [leave(one, x, whiten) for one in (level, *(bend_line(len(x), bends) for bends in _BENDS))]
    variance = max(own / (len(x) - len(whiten) - 1), 1e-300)
    size = float(x[place:].mean() - x[:place].mean())
    share = float(gain[best]) / float(np.sum((x - x.mean()) ** 2))
    return Shift((min(others) - own) / variance, share, float(t[place - 1 : place + 1].mean()), size)


@dataclass(frozen=True)
class Line:
    """A spectral line that runs have in common.

    Attributes
    ----------
    frequency : float
        [Hz]
    share : float
        Share of the residuals' power that it explains, mean over the runs.
    p_value : float
        p-value of an autoregression with a sine against one without, over all runs, corrected for the number
        of frequencies tried. The autoregression is needed since noise may have much power at low frequencies.
    """

    frequency: float
    share: float
    p_value: float


def find_line(residuals: Sequence[np.ndarray], rate: float) -> Line | None:
    """The spectral line that fits all runs' residuals best, its phase free in each; None with too few rows.

    Parameters
    ----------
    residuals : sequence of ndarray (N_r,)
        Residual of each run.
    rate : float
        Rate of the rows [Hz].
    """
    parts = [_average(x, rate) for x in residuals if len(x) >= _FEWEST and np.ptp(x) > 0.0]
    parts = [(t, x) for t, x in parts if np.ptp(x) > 0.0]
    if not parts:
        return None
    longest = max(float(t[-1]) for t, _ in parts)
    highest = min(_HIGHEST / float(t[1] - t[0]) for t, _ in parts)
    frequencies = np.arange(_PERIODS / longest, highest, 0.5 / longest)
    if not len(frequencies):
        return None
    held = np.array([hold_waves(t, x, frequencies) for t, x in parts])
    best = int(np.argmax(held.sum(axis=0)))
    near = frequencies[max(best - _NEAR // 2, 0) : best + _NEAR // 2 + 1]
    deviance = np.zeros(len(near))
    for t, x in parts:
        level = np.ones((len(x), 1))
        alone = leave(level, x, find_whitening(x))
        wave = make_waves(t, frequencies[best])
        whiten = find_whitening(x - wave @ np.linalg.lstsq(wave, x, rcond=None)[0])
        left = np.array([leave(np.column_stack([level, make_waves(t, f)]), x, whiten) for f in near])
        deviance += np.log(alone / np.maximum(left, 1e-300)) * (len(x) - len(whiten) - 2)
    k = int(np.argmax(deviance))
    p_value = min(1.0, 2.0 * len(frequencies) * float(stats.chi2.sf(deviance[k], 2 * len(parts))))
    return Line(float(near[k]), float(held[:, best].mean()), p_value)


def hold_waves(t: np.ndarray, x: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """Share (K,) of a series' power (M,) at times (M,) [s] that a sine of each frequency [Hz] explains."""
    shares = []
    for some in np.array_split(frequencies, -(-len(frequencies) // _AT_ONCE)):
        waves = make_waves(t, some)
        cosine, sine = waves[:, : len(some)], waves[:, len(some) :]
        a, b, c = (np.einsum("mk,mk->k", u, v) for u, v in ((cosine, cosine), (cosine, sine), (sine, sine)))
        p, q = x @ cosine, x @ sine
        shares.append((c * p**2 - 2.0 * b * p * q + a * q**2) / ((a * c - b**2) * (x @ x)))
    return np.concatenate(shares)


def _average(x: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] of equal stretches of a residual, and their means without outliers, less the whole mean."""
    every = max(1, len(x) // _LINE_ROWS)
    (mean,) = average(every, x)
    return (np.arange(len(mean)) + 0.5) * every / rate, cut_knocks(mean - mean.mean())


def make_waves(t: np.ndarray, frequencies: float | np.ndarray) -> np.ndarray:
    """Cosines and sines (M, 2 K) of frequencies (K,), or of one, [Hz] at times (M,) [s]."""
    phase = 2.0 * np.pi * np.outer(t, frequencies)
    return np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
