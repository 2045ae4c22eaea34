"""Test-cycle of point-to-point moves of all axes at three speeds."""

import numpy as np

from wearscope.cycles.base import Cycle, Reference
from wearscope.cycles.motion import MotionPlan
from wearscope.robots.model import RobotModel

# Shares of each axis's range; successive postures differ in every axis, so that every move moves every axis.
POSTURES = (
    (0.7, -0.5, 0.6, 0.5, -0.6, 0.8, 0.5),
    (-0.6, 0.4, -0.3, -0.7, 0.5, -0.6, -0.5),
    (0.3, 0.7, -0.8, 0.2, -0.4, 0.5, 0.6),
    (-0.8, -0.2, 0.4, 0.8, 0.7, -0.8, -0.2),
)
# Shares of the speed limits, and of the postures' distance from home: slow moves are shorter, to save time.
PASSES = ((1.0, 1.0), (0.5, 0.8), (0.15, 0.3))


def build(model: RobotModel, dwell: float, step: float) -> Reference:
    """Visit four postures at each of three speeds."""
    plan = MotionPlan(model, dwell, step)
    for speed, distance in PASSES:
        for shares in POSTURES:
            plan.move_to(plan.posture_at(distance * np.array(shares)), speed)
    plan.move_to(plan.home, 0.5)
    return plan.finish()


CYCLE = Cycle(
    "point_to_point",
    "Jerk-limited point-to-point moves of all axes at 100, 50 and 15 % of the speed limits.",
    build,
)
