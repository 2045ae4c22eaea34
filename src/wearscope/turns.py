"""Positions that begin again at a full turn."""

import numpy as np
from scipy import ndimage

from wearscope.robots.spatial import Array

#: Share of a turn by which a jump may differ from it, and from which a step of such a position is a jump.
_NEAR, _HALF = 0.05, 0.5


def unwrap_turns(x: Array, turn: float = 2.0 * np.pi) -> tuple[Array, int]:
    """Position (N,) without its jumps of a full turn, and how many there were.

    Where it stays within a turn, larger steps of the same kind are jumps as well: as between samples that
    lie far apart.
    """
    step = np.diff(x)
    if not (np.abs(step) > _HALF * turn).any():
        return x, 0
    odd = step - ndimage.median_filter(step, 11, mode="nearest")
    jumps = np.abs(np.abs(odd) - turn) < _NEAR * turn
    if jumps.any() and np.ptp(x) <= (1.0 + _NEAR) * turn:
        jumps = np.abs(step) > _HALF * turn
    turns = np.concatenate([[0.0], np.cumsum(np.sign(step) * jumps)])
    return x - turn * turns, int(jumps.sum())
