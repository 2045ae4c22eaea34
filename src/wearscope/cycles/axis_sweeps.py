"""Test-cycle in which one axis after another sweeps back and forth at low and high motor speeds."""

import numpy as np

from wearscope.cycles.base import Cycle, Reference
from wearscope.cycles.motion import MotionPlan
from wearscope.robots.model import RobotModel

# For each sweep: motor speed [rad/s]; time [s] that the distance from home takes at that speed, 0 for the way
# back home; side of the end. Wear changes friction much as temperature does, but differently between 1 and
# 50 rad/s than between 50 and 280 rad/s. So a test-cycle should visit both bands.
SWEEPS = ((15.0, 0.5, 1.0), (40.0, 0.4, -1.0), (110.0, 0.5, 1.0), (200.0, 0.4, -1.0), (200.0, 0.0, 1.0))
# A sweep covers at most this share of the excursion.
LARGEST_SHARE = 0.9


def build(model: RobotModel, dwell: float, step: float) -> Reference:
    """Sweep each of the first three axes alone, then the others together."""
    plan = MotionPlan(model, dwell, step)
    groups = [[axis] for axis in range(min(3, plan.n))] + [list(range(3, plan.n))]
    for group in groups:
        chosen = np.isin(np.arange(plan.n), group)
        for motor_speed, duration, side in SWEEPS:
            speed = plan.joint_speed(motor_speed)
            distance = np.minimum(speed * duration, LARGEST_SHARE * plan.excursion())
            target = plan.home + np.where(chosen, side * distance, 0.0)
            plan.move_to(target, acceleration=0.4, top_speed=speed)
    return plan.finish()


CYCLE = Cycle("axis_sweeps", "Each axis alone, back and forth at motor speeds from 15 to 200 rad/s.", build)
