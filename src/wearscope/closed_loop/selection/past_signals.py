"""Splines of what a joint's motion has been, for structure with a memory, which no present signal tells."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from scipy.signal import lfilter

from wearscope.closed_loop.intake.filtering import rows
from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.effects.base import Signals
from wearscope.effects.unknown import LEVELS

#: Times over which the past fades [s], and the longest, of the shortest run: longer ones go with time.
_MEMORIES, _LONGEST = (0.3, 1.0, 3.0, 10.0), 0.2
#: What fades, with the codes of its signals.
_FADING: tuple[tuple[tuple[str, ...], Callable[[Signals, int], np.ndarray]], ...] = (
    (("qd",), lambda s, j: s.v[:, j]),
    (("qd",), lambda s, j: np.abs(s.v[:, j])),
    (("sign_qd",), lambda s, j: s.sign[:, j]),
    (("load", "qd"), lambda s, j: np.abs(s.load[:, j] * s.v[:, j])),
)


def list_past(
    runs: list[PreparedRun], joint: int, levels: Sequence[int] = LEVELS[:1]
) -> Iterator[tuple[tuple[str, ...], np.ndarray]]:
    """Splines of a joint's past at its rows, alone and times the direction of motion, by hat functions.

    Speed, its size, the direction of motion and the mechanical power, filtered to the past as if the joint
    had rested before each run; and the position at which the joint last turned round.

    Yields
    ------
    tuple of str
        Codes of the signals.
    ndarray (M, m)
    """
    sign = np.concatenate([run.reduce(run.signals.sign[:, [joint]]) for run in runs])
    shortest = min(len(run.signals.t) / run.band.rate for run in runs)
    times = [time for time in _MEMORIES if time <= _LONGEST * shortest]
    every = [(codes, _remember(runs, joint, take, time)) for codes, take in _FADING for time in times]
    for codes, x in [*every, (("q",), _last_turn(runs, joint))]:
        low, high = np.quantile(x, [0.002, 0.998])
        if high - low > 1e-9 * (1.0 + abs(high)):
            for knots in levels:
                columns = _spline(x, low, high, knots)
                yield codes, columns
                yield tuple(dict.fromkeys((*codes, "sign_qd"))), columns * sign


def _remember(
    runs: list[PreparedRun], joint: int, take: Callable[[Signals, int], np.ndarray], time: float
) -> np.ndarray:
    """A signal filtered to its past over some time, at the rows (M,)."""
    parts = []
    for run in runs:
        keep = np.exp(-1.0 / (run.band.rate * time))
        past = lfilter([1.0 - keep], [1.0, -keep], take(run.signals, joint))
        parts.append(past[rows(run.band, len(past))])
    return np.concatenate(parts)


def _last_turn(runs: list[PreparedRun], joint: int) -> np.ndarray:
    """Position at which a joint last turned round, at the rows (M,); before, where its run starts."""
    parts = []
    for run in runs:
        forwards = run.signals.v[:, joint] > 0.0
        turned = np.concatenate([[False], forwards[1:] != forwards[:-1]])
        last = np.maximum.accumulate(np.where(turned, np.arange(len(turned)), 0))
        parts.append(run.signals.q[last, joint][rows(run.band, len(last))])
    return np.concatenate(parts)


def _spline(x: np.ndarray, low: float, high: float, knots: int) -> np.ndarray:
    """Hat functions (M, knots) between two values, constant beyond."""
    place = np.clip((x - low) / (high - low), 0.0, 1.0) * (knots - 1)
    return np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(knots)))
