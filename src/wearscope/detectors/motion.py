"""Signals that detectors derive from a recording, computed once a batch."""

from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import savgol_filter

from wearscope.detectors.base import Array, Batch

if TYPE_CHECKING:
    from wearscope.robots.model import RobotModel


def estimate_acceleration(batch: Batch, window: float = 0.03) -> Array:
    """Joint acceleration by a zero-phase filter of the recorded speed.

    Parameters
    ----------
    batch : Batch
    window : float
        Length of the filter [s], widened to 5 samples where they take longer.

    Returns
    -------
    array (N, n)
        Derivative of the local least-squares parabola of `qd` (Savitzky and Golay, Anal. Chem. 36, 1964),
        symmetric about its sample, hence without lag.
    """
    key = ("acceleration", window)
    if key not in batch.derived:
        half = max(2, round(0.5 * window * batch.sample_rate))
        length = 2 * half + 1
        if length > len(batch.t):
            raise ValueError(f"the batch has {len(batch.t)} samples, the acceleration needs {length}")
        batch.derived[key] = savgol_filter(
            batch.qd, length, polyorder=2, deriv=1, delta=1.0 / batch.sample_rate, axis=0
        )
    return batch.derived[key]
