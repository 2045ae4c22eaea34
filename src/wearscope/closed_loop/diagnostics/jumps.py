"""Levels in time: a residual that keeps to a few, as noise of its own spectrum would not, or shifts once.

A residual that jumps is autocorrelated over whole runs, and so is a slow drift. What tells them apart is not
in the spectrum: random phases keep it and lose the levels (surrogate data, Theiler et al. 1992, Physica D
58); and a drift, or a random walk, is held as well by a line that bends as often.

Noise with a memory wanders, and the best placed step holds much of it. A shift is told by its one moment:
with the residual made white by an autoregression, a step is a lone pulse, which wandering does not have (Tsay
1988, Journal of Forecasting 7: level shifts in time series). A line that bends models what drifts.
"""

from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.inference.series import average, bend_line, cut_knocks, find_whitening, leave

#: Numbers of jumps that are tried in a run.
_JUMPS = (1, 4, 16, 64)
#: Share of the residual's variance that the levels may leave; of what they leave of its surrogates, and of
#: what a line that bends as often leaves of the residual.
_LEFT, _OF_OTHERS = 0.1, 0.3
#: Standard deviations of the surrogates' by which its logarithm must lie below theirs.
_BELOW = 6.0
_SURROGATES, _SEED = 39, 17
#: Rows that are looked at (more are averaged), and fewest; shortest level.
_MOST_ROWS, _LEAST_ROWS, _SHORTEST = 600, 100, 5
#: Filter that leaves a series as it is.
_PLAIN = np.ones(1)


@dataclass(frozen=True)
class Jumps:
    """Levels of a residual.

    Attributes
    ----------
    share : float
        Of its variance that they hold.
    time : float
        Of the largest jump [s].
    size : float
        Of the largest jump.
    """

    share: float
    time: float
    size: float


def find_jumps(t: np.ndarray, x: np.ndarray) -> Jumps | None:
    """Levels between jumps in time that hold a residual, if there are such.

    Parameters
    ----------
    t : ndarray (M,)
        Times of the rows that count [s].
    x : ndarray (M,)
        Residual there.
    """
    if len(x) < _LEAST_ROWS or not np.ptp(x) > 0.0:
        return None
    every = max(1, len(x) // _MOST_ROWS)
    t, x = average(every, t, x)
    left = {jumps: _left(x, _fit_levels(x, jumps)) for jumps in _JUMPS}
    left = {
        jumps: own
        for jumps, own in left.items()
        if own <= min(_LEFT, _OF_OTHERS * leave(bend_line(len(x), jumps), x, _PLAIN) / (len(x) * np.var(x)))
    }
    if not left:
        return None
    surrogates = _randomise_phases(x)
    for jumps, own in left.items():
        others = np.array([_left(s, _fit_levels(s, jumps)) for s in surrogates])
        logs = np.log(np.maximum(others, 1e-12))
        below = logs.mean() - np.log(max(own, 1e-12)) > _BELOW * logs.std(ddof=1)
        if own <= _OF_OTHERS * others.mean() and below:
            levels = _fit_levels(x, jumps)
            k = int(np.argmax(np.abs(np.diff(levels))))
            return Jumps(1.0 - own, float(t[k : k + 2].mean()), float(levels[k + 1] - levels[k]))
    return None


def _fit_levels(x: np.ndarray, jumps: int) -> np.ndarray:
    """Levels (M,) between so many jumps at most, each placed where it leaves least with those before it."""
    pieces = {(0, len(x)): _place_step(x)}
    for _ in range(jumps):
        (begin, end), (place, gain) = max(pieces.items(), key=lambda piece: piece[1][1])
        if not gain > 0.0:
            break
        del pieces[begin, end]
        for part in ((begin, begin + place), (begin + place, end)):
            pieces[part] = _place_step(x[slice(*part)])
    levels = np.empty(len(x))
    for begin, end in pieces:
        levels[begin:end] = x[begin:end].mean()
    return levels


def _left(x: np.ndarray, levels: np.ndarray) -> float:
    return float(np.mean((x - levels) ** 2) / np.var(x))


def _randomise_phases(x: np.ndarray) -> np.ndarray:
    """Noise (S, M) with the spectrum of a series (M,)."""
    rng = np.random.default_rng(_SEED)
    spectrum = np.fft.rfft(x - x.mean())
    phases = np.exp(2j * np.pi * rng.random((_SURROGATES, len(spectrum))))
    phases[:, 0] = 1.0
    if len(x) % 2 == 0:
        phases[:, -1] = 1.0
    return np.fft.irfft(spectrum * phases, len(x))


#: Rows in which a shift is looked for at most, of so many averaged at least: the common filter makes a step
#: that long.
_SHIFT_ROWS, _FEWEST = 200, 3
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
    every = max(_FEWEST, len(x) // _SHIFT_ROWS)
    t, x = average(every, t, x)
    x = cut_knocks(x)
    if not np.ptp(x) > 0.0:
        return None
    place, gain = _place_step(x)
    before = np.cumsum(x)[place - 1]
    step = np.where(np.arange(len(x)) < place, before / place, (x.sum() - before) / (len(x) - place))
    whiten = find_whitening(x - step)
    after, level = np.arange(len(x)), np.ones(len(x))
    first, last = max(place - _NEAR, _SHORTEST), min(place + _NEAR, len(x) - _SHORTEST)
    own, place = min(
        (leave(np.column_stack([level, after >= k]), x, whiten), k) for k in range(first, last + 1)
    )
    others = [leave(one, x, whiten) for one in (level, *(bend_line(len(x), bends) for bends in _BENDS))]
    variance = max(own / (len(x) - len(whiten) - 1), 1e-300)
    size = float(x[place:].mean() - x[:place].mean())
    share = gain / float(np.sum((x - x.mean()) ** 2))
    return Shift((min(others) - own) / variance, share, float(t[place - 1 : place + 1].mean()), size)


def _place_step(x: np.ndarray) -> tuple[int, float]:
    """Row of the step that takes most of a series' (M,) squares, and how much; 0 of too short a series."""
    k = np.arange(_SHORTEST, len(x) - _SHORTEST + 1)
    if not len(k):
        return 0, 0.0
    before = np.cumsum(x)[k - 1]
    low, high = before / k, (x.sum() - before) / (len(x) - k)
    gain = (high - low) ** 2 * k * (len(x) - k) / len(x)
    best = int(np.argmax(gain))
    return int(k[best]), float(gain[best])
