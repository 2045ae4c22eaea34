"""A robot's postures along a test-cycle, for looking at it."""

import numpy as np
import pandas as pd

from wearscope.cycles.base import Cycle
from wearscope.robots.model import RobotModel

FRAMES = 120
_STEP = 0.01


def posture_table(model: RobotModel, cycle: Cycle, dwell: float, frames: int = FRAMES) -> pd.DataFrame:
    """Positions of base, joints and end of a robot at evenly spaced times of a test-cycle.

    Parameters
    ----------
    model : RobotModel
    cycle : Cycle
    dwell : float
        Delay before each next move [s].
    frames : int

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``frame``, ``t`` [s], ``place`` (0 is the base), ``name``, ``x``, ``y``, ``z``
        [m], in the base frame.
    """
    reference = cycle.build(model, dwell, _STEP)
    rows = np.unique(np.linspace(0, len(reference.t) - 1, frames).round().astype(int))
    points = model.rigid_body(model.declared_payload).joint_origins(reference.q[rows])
    names = ["base", *model.joints, "end"]
    count = len(names)
    return pd.DataFrame(
        {
            "robot": model.name,
            "cycle": cycle.name,
            "frame": np.repeat(np.arange(len(rows)), count),
            "t": np.repeat(reference.t[rows], count),
            "place": np.tile(np.arange(count), len(rows)),
            "name": np.tile(names, len(rows)),
            **{axis: points[:, :, k].ravel() for k, axis in enumerate("xyz")},
        }
    )
