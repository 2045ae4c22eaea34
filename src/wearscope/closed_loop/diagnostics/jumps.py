"""Jumps in time: a residual that keeps to a few levels, as noise of its own spectrum would not.

A residual that jumps is autocorrelated over whole runs, and so is a slow drift. What tells them apart is not
in the spectrum: random phases keep it and lose the levels (surrogate data, Theiler et al. 1992, Physica D
58); and a drift, or a random walk, is held as well by a line that bends as often.
"""

from dataclasses import dataclass

import numpy as np
from sklearn.tree import DecisionTreeRegressor

from wearscope.closed_loop.selection.series import average, bend_line

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
        if own <= min(_LEFT, _OF_OTHERS * _left(x, _fit_line(x, jumps)))
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
    """Levels (M,) between so many jumps at most, each placed where it leaves least beside those before it."""
    row = np.arange(len(x), dtype=float)[:, None]
    tree = DecisionTreeRegressor(max_leaf_nodes=jumps + 1, min_samples_leaf=_SHORTEST, random_state=_SEED)
    return np.asarray(tree.fit(row, x).predict(row))


def _fit_line(x: np.ndarray, bends: int) -> np.ndarray:
    """A line (M,) that bends so many times, at equal distances."""
    hats = bend_line(len(x), bends)
    return np.asarray(hats @ np.linalg.lstsq(hats, x, rcond=None)[0])


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
