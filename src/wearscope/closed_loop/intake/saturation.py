"""Torque samples that are not measurements: clipped ones are found, and gaps are bridged before filtering.

The declared model, with friction and inertia fitted joint by joint, predicts roughly what a joint would have
needed. The prediction serves only to find where a torque stays at a level that the motion must have exceeded,
and to carry the common filter across the gap. Rows in a gap never count.
"""

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from wearscope.closed_loop.intake.filtering import REST_SHARE

#: Least share of a run's rows, and least number of them, at a level that is taken for a limit.
_SHARE, _ROWS = 0.002, 5
#: Factors of a stated limit: a torque is at the limit from the first on, and beyond it from the second on.
_AT, _OVER = 0.999, 1.05
#: Share of a torque's span by which the rough prediction must exceed a limit.
_BEYOND = 0.02
#: A level is no limit where the torque beyond it correlates this much with its prediction: friction makes
#: plateaus too, which rise with the torque that the motion needs.
_FOLLOWS = 0.5
#: A level is friction and no limit where more than this share of the fast samples of one direction are at it
#: (faster than `_FAST` of the top speed): friction depends on the direction, a limit on the needed torque.
_WHENEVER, _FAST = 0.95, 0.2


def _at_exact_level(tau: np.ndarray, top: bool) -> np.ndarray:
    """Samples (N,) at the largest (`top`) or smallest value, if more are there than at the next three."""
    values, counts = np.unique(tau, return_counts=True)
    order = slice(None, None, -1) if top else slice(None)
    values, counts = values[order], counts[order]
    enough = counts[0] > max(_ROWS, _SHARE * len(tau)) and counts[0] > counts[1:4].sum()
    return tau == values[0] if enough else np.zeros(len(tau), dtype=bool)


def _comes_with_direction(at: np.ndarray, v: np.ndarray) -> bool:
    """Whether nearly all fast samples of one direction are marked (N,), and nearly none of the other."""
    fast = np.abs(v) > _FAST * np.abs(v).max()
    ways = [at[fast & (v > 0.0)], at[fast & (v < 0.0)]]
    shares = sorted(float(way.mean()) if len(way) else 0.0 for way in ways)
    return shares[1] > _WHENEVER and shares[0] < 1.0 - _WHENEVER


def _at_noisy_level(x: np.ndarray, predicted: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Samples (N,) near a torque's top level, if the torque stays there while the prediction exceeds it."""
    none = np.zeros(len(x), dtype=bool)
    noise = 1.4826 * float(np.median(np.abs(np.diff(x, 2)))) / np.sqrt(6.0)
    span = float(np.ptp(np.percentile(x, [0.5, 99.5])))
    top = float(np.quantile(x, 0.998))
    moves_at_all = np.abs(v) > REST_SHARE * np.abs(v).max()
    beyond = (predicted > top + _BEYOND * span) & moves_at_all
    if beyond.sum() < max(_ROWS, _SHARE * len(x)):
        return none
    level = float(np.median(x[beyond]))
    spread = 1.4826 * float(np.median(np.abs(x[beyond] - level)))
    width = max(4.0 * noise, 0.01 * span)
    stays = spread < 0.5 * width and np.mean(np.abs(x[beyond] - level) < width) > 0.9
    moves = float(np.std(predicted[beyond])) > max(5.0 * spread, 0.007 * span)
    if not (stays and moves and top - level < width):
        return none
    if x[beyond].std() > 0.0 and np.corrcoef(x[beyond], predicted[beyond])[0, 1] > _FOLLOWS:
        return none
    at = x > level - width
    return none if _comes_with_direction(at, v) else at


def goes_beyond(tau: np.ndarray, limit: float) -> bool:
    """Whether most samples of a torque (N,) that reach a stated limit exceed it, so that it is wrong."""
    over = np.abs(tau[np.abs(tau) >= _AT * limit])
    return bool(np.mean(over > _OVER * limit) > 0.5) if len(over) else False


def find_clipped(
    tau: np.ndarray, predicted: np.ndarray, v: np.ndarray, limits: Sequence[float]
) -> np.ndarray:
    """Samples (N, n) at a limit of the drive.

    Parameters
    ----------
    tau, predicted : ndarray (N, n)
        Measured torque, and what the motion needs roughly.
    v : ndarray (N, n)
        Speed.
    limits : sequence of float
        Torque limits; infinite where none is known.
    """
    clipped = np.zeros(tau.shape, dtype=bool)
    for j in range(tau.shape[1]):
        clipped[:, j] |= np.abs(tau[:, j]) >= _AT * limits[j]
        for sign in (1.0, -1.0):
            clipped[:, j] |= _at_exact_level(tau[:, j], sign > 0)
            clipped[:, j] |= _at_noisy_level(sign * tau[:, j], sign * predicted[:, j], v[:, j])
    return clipped


def bridge_torque(tau: np.ndarray, predicted: np.ndarray, bad: np.ndarray) -> np.ndarray:
    """Torque (N, n) with bad samples replaced by the prediction, shifted to meet their good neighbours."""
    bridged = tau.copy()
    rows = np.arange(len(tau))
    for j in np.flatnonzero(bad.any(axis=0)):
        good = ~bad[:, j]
        if good.any():
            off = np.interp(rows, rows[good], (tau - predicted)[good, j])
            bridged[~good, j] = predicted[~good, j] + off[~good]
    return bridged


def spread_out(bad: np.ndarray, width: int) -> np.ndarray:
    """Mark `width` samples on either side of every marked sample (N, n)."""
    return ndimage.maximum_filter1d(bad, 2 * width + 1, axis=0, mode="constant", cval=False)


def keep_lasting(marked: np.ndarray, width: int) -> np.ndarray:
    """Marked samples (N, n) that are part of a stretch longer than `width` samples."""
    inner = ndimage.minimum_filter1d(marked, width + 1, axis=0, mode="constant", cval=False)
    # A window of even length has no central sample: the second filter is shifted back by what the first was.
    return marked & ndimage.maximum_filter1d(
        inner, width + 1, axis=0, mode="constant", cval=False, origin=-1 if width % 2 else 0
    )
