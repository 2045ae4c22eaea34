"""A spectral line: a torque that is periodic in time.

Of one run a line shows in its spectrum from some periods on. That several runs have one of the same
frequency, whatever its phase in each, shows with fewer periods and beneath more noise, in the residual made
white.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, signal, stats

from wearscope.closed_loop.inference.series import average, cut_knocks, find_whitening, leave

#: A spectral line stands out of its neighbours' median by this factor: chance gives it once in 1e4 runs.
_LINE, _NEIGHBOURS = 40.0, 41
#: Fewest periods of it in a run.
_PERIODS = 8
#: Highest peaks that are compared with what lies below them.
_PEAKS = 20
#: Shortest residual that is looked at [rows].
_LEAST_ROWS = 512
#: A common line: rows of each run that are looked at, at least and at most (more are averaged), fewest
#: periods in the longest run, highest frequency [1/row], and frequencies about the best one in the residual
#: itself that are compared.
FEWEST_ROWS, _MOST_ROWS, _FEWEST_PERIODS, _HIGHEST, _NEAR = 128, 300, 2.5, 0.25, 2
#: Frequencies whose waves are made at once.
_AT_ONCE = 256


@dataclass(frozen=True)
class Line:
    """The highest line of a spectrum.

    Attributes
    ----------
    frequency : float
        [Hz]
    share : float
        Of the residual's power that it holds; zero where it does not stand out of its neighbours.
    """

    frequency: float
    share: float


def find_line(x: np.ndarray, rate: float, least: int = _LEAST_ROWS) -> Line | None:
    """The line that stands out most of a residual's spectrum; None where there is too little of it.

    Parameters
    ----------
    x : ndarray (N,)
        Residual of a run.
    rate : float
        [Hz]
    least : int
        Fewest rows.
    """
    if len(x) < least:
        return None
    window = signal.windows.hann(len(x))
    power = np.abs(np.fft.rfft((x - x.mean()) * window)) ** 2
    around = ndimage.median_filter(power, _NEIGHBOURS, mode="nearest")
    first = _PERIODS
    ratio = power[first:] / np.maximum(around[first:], 1e-300)
    for k in first + np.argsort(-ratio)[:_PEAKS]:
        # Noise with a memory has more power below than the median of both sides says.
        below = float(np.median(power[k // 2 : k - 2])) if k > 4 else float(power[1])
        ratio[k - first] = power[k] / max(around[k], below, 1e-300)
    k = first + int(np.argmax(ratio))
    near = slice(max(k - 2, 0), k + 3)
    share = float((power[near] - around[near]).clip(0.0).sum() / max(power[1:].sum(), 1e-300))
    return Line(k * rate / len(x), share if ratio.max() > _LINE else 0.0)


@dataclass(frozen=True)
class CommonLine:
    """A line that runs have in common.

    Attributes
    ----------
    frequency : float
        [Hz]
    share : float
        Of the residuals' power that it holds, mean over the runs.
    p_value : float
        Of a sine at so many frequencies next to an autoregression, in all runs together, as the noise is with
        the sine or without it, whichever speaks against it: what wanders has much at a few periods.
    """

    frequency: float
    share: float
    p_value: float


def find_common_line(residuals: Sequence[np.ndarray], rate: float) -> CommonLine | None:
    """The line that fits the residuals of all runs best; None where there is too little of them.

    Parameters
    ----------
    residuals : sequence of ndarray (N_r,)
        Of each run.
    rate : float
        [Hz]
    """
    parts = [_average(x, rate) for x in residuals if len(x) >= FEWEST_ROWS and np.ptp(x) > 0.0]
    parts = [(t, x) for t, x in parts if np.ptp(x) > 0.0]
    if not parts:
        return None
    longest = max(float(t[-1]) for t, _ in parts)
    highest = min(_HIGHEST / float(t[1] - t[0]) for t, _ in parts)
    frequencies = np.arange(_FEWEST_PERIODS / longest, highest, 0.5 / longest)
    if not len(frequencies):
        return None
    held = np.array([hold_waves(t, x, frequencies) for t, x in parts])
    best = int(np.argmax(held.sum(axis=0)))
    near = frequencies[max(best - _NEAR, 0) : best + _NEAR + 1]
    deviance = np.zeros(len(near))
    for t, x in parts:
        wave = make_waves(t, frequencies[best])
        level = np.ones((len(x), 1))
        each = []
        for noise in (x, x - wave @ np.linalg.lstsq(wave, x, rcond=None)[0]):
            whiten = find_whitening(noise)
            alone = leave(level, x, whiten)
            left = np.array([leave(np.column_stack([level, make_waves(t, f)]), x, whiten) for f in near])
            each.append((alone / np.maximum(left, 1e-300) - 1.0) * (len(x) - len(whiten) - 2))
        deviance += np.minimum(*each)
    k = int(np.argmax(deviance))
    p_value = min(1.0, 2.0 * len(frequencies) * float(stats.chi2.sf(deviance[k], 2 * len(parts))))
    return CommonLine(float(near[k]), float(held[:, best].mean()), p_value)


def hold_waves(t: np.ndarray, x: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """Share (K,) of a series' power (M,) at times (M,) [s] that a sine of each frequency [Hz] holds."""
    shares = []
    for some in np.array_split(frequencies, -(-len(frequencies) // _AT_ONCE)):
        waves = make_waves(t, some)
        cosine, sine = waves[:, : len(some)], waves[:, len(some) :]
        a, b, c = (np.einsum("mk,mk->k", u, v) for u, v in ((cosine, cosine), (cosine, sine), (sine, sine)))
        p, q = x @ cosine, x @ sine
        shares.append((c * p**2 - 2.0 * b * p * q + a * q**2) / ((a * c - b**2) * (x @ x)))
    return np.concatenate(shares)


def _average(x: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and means of equal stretches of a residual, without its mean and knocks."""
    every = max(1, len(x) // _MOST_ROWS)
    (mean,) = average(every, x)
    return (np.arange(len(mean)) + 0.5) * every / rate, cut_knocks(mean - mean.mean())


def make_waves(t: np.ndarray, frequencies: float | np.ndarray) -> np.ndarray:
    """Cosines and sines (M, 2 K) of frequencies (K,), or of one, [Hz] at times (M,) [s]."""
    phase = 2.0 * np.pi * np.outer(t, frequencies)
    return np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
