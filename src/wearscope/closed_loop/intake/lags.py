"""Torques that come late or early at all joints: by a delay of the recorder, or behind a filter.

The time is that at which one fit of all rows leaves least. How far it is known tells what is left without one
block of rows after the other: a model that lacks something leaves much, whatever the time, but moves it from
block to block. So no share of the torque has to be explained for a delay to be one. But it must leave less
than links of any size do: at a single frequency, wrong masses and a delay are the same.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from wearscope.closed_loop.intake.asked import Asked, Reading
from wearscope.closed_loop.intake.joint_fit import LEAST_ROWS, Rows

#: Longest time that is sought, its step, and the least that is the recorder's [s].
_LONGEST, _STEP, _LAG = 0.3, 0.02, 0.025
#: Rows on which times are sought, and blocks of them.
_ROWS, _BLOCKS = 900, 12
#: Standard errors by which a time differs from none; by which a loss is larger.
_SURE, _MORE = 4.0, 2.0
#: Share of a torque's variance, half of it as RMS, beyond which the model tells nothing of it.
_JUDGED = 0.25
#: Least time [s] that is noted; share of what is left that twice as much leaves at most where it is sought;
#: that the best leaves, and that it leaves at each joint.
_SOON, _SOONER, _CLEAR, _EACH = 0.005, 0.8, 0.3, 0.5


@dataclass(frozen=True)
class _Lag:
    """A time by which torques are late.

    Attributes
    ----------
    time, error : float
        And its standard error [s].
    rows : Rows
        With torques at their moment.
    losses : ndarray (B, n)
        What is left by block and joint, in shares of each torque's variance.
    """

    time: float
    error: float
    rows: Rows
    losses: np.ndarray


def read_lag(asked: Asked, heard: tuple[int, ...]) -> Iterator[Reading]:
    """Torques of all joints late or early by one time, or smoothed over it."""
    # Beyond the ends of a recording there is no torque.
    inside = np.flatnonzero(asked.room > _LONGEST)
    if not heard or asked.rows.counts[inside].sum(axis=0).max(initial=0) < LEAST_ROWS:
        return
    at = inside[:: max(1, len(inside) // _ROWS)]
    stated = asked.rows.pick(at).leave(_cut(at))
    late, smooth = _find_delay(asked, at), _find_filter(asked, at)
    filtered = _is_more(late.losses.sum(axis=1) - smooth.losses.sum(axis=1))
    lag = smooth if filtered else late
    if abs(lag.time) < max(_LAG, _SURE * lag.error):
        return
    worse = any(_is_more(lag.losses[:, j] - stated[:, j]) for j in heard)
    shown = not worse and bool(np.median(lag.losses.sum(axis=0)[list(heard)]) < _JUDGED)
    told, by = f"the torque channels come {1000 * abs(lag.time):.0f} ms ", "late" if lag.time > 0 else "early"
    told += f"{by} against the positions; align the channels, or declare time_delay."
    if filtered:
        told = (
            f"the torques are smoothed over about {1000 * lag.time:.0f} ms, as behind a low-pass filter; "
            "record them without it, or declare time_delay, which undoes most of it where motions are slow."
        )
        read = asked.rows.pick(inside).with_torques(_sharpen(asked, lag.time)[inside])
    else:
        read = asked.rows.pick(inside).with_torques(asked.torque_at(lag.time, 0)[inside])
    yield Reading(told, ("late tau",), heard, read.products, shown=shown)


def find_lag(asked: Asked) -> float | None:
    """Time [s] by which a delay or a filter of first order makes all torques late; None where neither does.

    It must leave a small share of what is left without it, at no joint more than half.
    """
    at = np.flatnonzero(asked.room > _LONGEST)
    at = at[:: max(1, len(at) // _ROWS)]
    rows = asked.rows.pick(at)
    heard, stated = rows.products.heard, rows.fitted
    if not heard or not stated.is_doubtful:
        return None
    if rows.with_torques(asked.torque_at(2.0 * _SOON, 0)[at]).products.total > _SOONER * stated.total:
        return None
    both = [(lag.rows.fitted, lag.time) for lag in (_find_delay(asked, at), _find_filter(asked, at))]
    fit, time = min(both, key=lambda one: one[0].total)
    clear = fit.total < _CLEAR * stated.total and np.all(fit.left[heard] < _EACH * stated.left[heard])
    return time if clear and time > _SOON else None


def _cut(at: np.ndarray) -> np.ndarray:
    """Block of each row."""
    return np.arange(len(at)) * _BLOCKS // len(at)


def _is_more(differences: np.ndarray) -> bool:
    """Whether differences of blocks (B,) are clearly more than none."""
    error = differences.std(ddof=1) / np.sqrt(len(differences))
    return bool(differences.mean() > _MORE * error)


def _sharpen(asked: Asked, time: float) -> np.ndarray:
    """Torques (N, n) before a filter of first order."""
    return asked.torque_at(0.0, 0) + time * asked.torque_at(0.0, 1)


def _find_delay(asked: Asked, at: np.ndarray) -> _Lag:
    tried = np.arange(-_LONGEST, _LONGEST + 0.5 * _STEP, _STEP)
    return _find(asked, at, tried, lambda time: asked.torque_at(time, 0))


def _find_filter(asked: Asked, at: np.ndarray) -> _Lag:
    tried = np.arange(0.0, _LONGEST + 0.5 * _STEP, _STEP)
    return _find(asked, at, tried, lambda time: _sharpen(asked, time))


def _find(asked: Asked, at: np.ndarray, tried: np.ndarray, torques: Callable[[float], np.ndarray]) -> _Lag:
    """The time at which rows leave least, and its error by leaving out each block."""
    rows, blocks = asked.rows.pick(at), _cut(at)

    def move(time: float) -> Rows:
        return rows.with_torques(torques(time)[at])

    moved = [move(time) for time in tried.tolist()]
    losses = np.array([one.leave(blocks).sum(axis=1) for one in moved])
    whole = np.array([one.products.total for one in moved])
    without = np.array([_find_lowest(tried, whole - one) for one in losses.T])
    error = np.sqrt((len(without) - 1) * np.mean((without - without.mean()) ** 2))
    best = _find_lowest(tried, whole)
    fine = optimize.minimize_scalar(
        lambda time: move(time).products.total, method="bounded", options={"xatol": 5e-4},
        bounds=(max(best - _STEP, tried[0]), min(best + _STEP, tried[-1])),
    )  # fmt: skip
    time = float(fine.x)
    return _Lag(time, float(error), move(time), move(time).leave(blocks))


def _find_lowest(x: np.ndarray, y: np.ndarray) -> float:
    """Where a curve is lowest, by the parabola through its lowest points."""
    k = int(np.clip(np.argmin(y), 1, len(y) - 2))
    slope, bend = y[k + 1] - y[k - 1], y[k + 1] - 2.0 * y[k] + y[k - 1]
    off = -0.5 * slope / bend if bend > 0.0 else float(np.argmin(y) - k)
    return float(x[k] + np.clip(off, -1.0, 1.0) * (x[1] - x[0]))
