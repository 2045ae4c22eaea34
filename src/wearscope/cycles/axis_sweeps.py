"""One axis after another back and forth, in a low and a high speed band of its motor."""

import numpy as np

from wearscope.cycles.base import Cycle, Reference
from wearscope.cycles.motion import MotionPlan
from wearscope.robots.model import RobotModel

# Motor speed [rad/s] of each sweep, time [s] at that speed from home to the end of the sweep, side of the
# end. How wear resembles temperature differs between the bands 1 to 50 and 50 to 280 rad/s, so a test-cycle
# should visit both.
SWEEPS = ((15.0, 0.5, 1.0), (40.0, 0.4, -1.0), (110.0, 0.5, 1.0), (200.0, 0.4, -1.0), (200.0, 0.0, 1.0))
# A sweep ends within this share of the excursion.
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
