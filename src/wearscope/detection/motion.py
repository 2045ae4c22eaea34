"""Whether two recordings are of the same motion, whatever they waited before, between and after."""

from dataclasses import dataclass

import numpy as np

from wearscope.detectors.base import Array, Batch

#: A joint counts as moving above this share of its highest speed.
REST = 0.01
#: Places along the path at which two motions are compared.
PLACES = 400
#: Largest distance of two equal motions, as share of a joint's range; largest difference of the time in
#: motion at a place, as share of the whole: tracking, wear and temperature change far less.
POSITION, TIME = 0.05, 0.05
#: A joint's range counts as at least this share of the largest one: one that hardly moves shows only noise.
LEAST_RANGE = 0.02


@dataclass(frozen=True)
class Path:
    """Where the joints are along the way of a motion, rests left out.

    Attributes
    ----------
    q : ndarray (PLACES, n)
        Position at equal shares of the way.
    time : ndarray (PLACES,)
        Time in motion until there [s].
    """

    q: Array
    time: Array


def cut_rests(batch: Batch) -> Batch:
    """Batch from the first to the last sample at which a joint moves.

    Raises
    ------
    ValueError
        Where none does.
    """
    moving = np.flatnonzero(find_moving(batch, top_speeds(batch)))
    if len(moving) < 2:
        raise ValueError("no joint moves")
    part = slice(moving[0], moving[-1] + 1)
    return Batch(batch.t[part], batch.q[part], batch.qd[part], batch.tau[part], batch.sample_rate)


def top_speeds(batch: Batch) -> Array:
    """Highest speed (n,) of each joint; infinite for one that hardly moves against the others."""
    top = np.abs(batch.qd).max(axis=0)
    return np.where(np.ptp(batch.q, axis=0) >= _scale(batch), top, np.inf)


def find_moving(batch: Batch, top: Array) -> np.ndarray:
    """Samples (N,) of bool at which a joint moves, with the highest speeds (n,) of the motion."""
    return np.asarray((np.abs(batch.qd) > REST * top).any(axis=1))


def _scale(batch: Batch) -> Array:
    reach = np.ptp(batch.q, axis=0)
    return np.maximum(reach, LEAST_RANGE * reach.max())


def follow_path(batch: Batch, top: Array) -> Path:
    """Path of a batch, its way being the sum of all joints' motion, each in units of its highest speed.

    Parameters
    ----------
    batch : Batch
    top : ndarray (n,)
        Highest speeds, of the motion that it is compared with.

    Raises
    ------
    ValueError
        Where no joint moves.
    """
    moving = find_moving(batch, top)
    progress = np.where(moving, (np.abs(batch.qd) / top).sum(axis=1), 0.0)
    if not progress.any():
        raise ValueError("no joint moves")
    way = np.cumsum(progress) - 0.5 * progress
    time = np.cumsum(moving) / batch.sample_rate
    share = np.linspace(0.0, 1.0, PLACES)
    at = way[moving] / progress.sum()
    q = np.column_stack([np.interp(share, at, x) for x in batch.q[moving].T])
    return Path(q, np.interp(share, at, time[moving]))


def tell_difference(reference: Batch, other: Batch, joints: list[str]) -> str | None:
    """What makes another recording one of another motion, in words; None where it is the same.

    Parameters
    ----------
    reference, other : Batch
    joints : list of str
    """
    top = top_speeds(reference)
    try:
        first, second = follow_path(reference, top), follow_path(other, top)
    except ValueError as error:
        return str(error)
    away = np.abs(second.q - first.q) / _scale(reference)
    place, j = (int(k) for k in np.unravel_index(np.argmax(away), away.shape))
    if away[place, j] > POSITION:
        far = (
            f"{100 * away[place, j]:.0f} % of its range"
            if away[place, j] <= 1.0
            else "more than its whole range"
        )
        return f"joint '{joints[j]}' is {far} away after {100 * place / (PLACES - 1):.0f} % of the way"
    late = (second.time - first.time) / first.time[-1]
    place = int(np.argmax(np.abs(late)))
    if abs(late[place]) > TIME:
        word = "slower" if late[place] > 0 else "faster"
        return f"it is {word}, by {100 * abs(late[place]):.0f} % of the time in motion"
    return None
