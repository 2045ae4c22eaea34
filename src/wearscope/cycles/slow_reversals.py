"""Test-cycle of slow reversals of all axes about two postures."""

import numpy as np

from wearscope.cycles.base import Cycle, Reference
from wearscope.cycles.motion import MotionPlan
from wearscope.robots.model import RobotModel

# Shares of each axis's range; and direction in which each axis starts a stroke.
POSTURES = ((0.5, -0.4, 0.5, 0.4, 0.4, 0.5, 0.4), (-0.5, 0.4, -0.5, -0.4, -0.4, -0.5, -0.4))
DIRECTIONS = (1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0)
# Motor speed of each stroke [rad/s], and time that its distance takes at that speed [s].
STROKES = ((4.0, 0.4), (12.0, 0.4), (36.0, 0.4))


def build(model: RobotModel, dwell: float, step: float) -> Reference:
    """Make strokes back and forth at three slow speeds about each posture."""
    plan = MotionPlan(model, dwell, step)
    turn = np.resize(DIRECTIONS, plan.n)
    for shares in POSTURES:
        centre = plan.posture_at(shares)
        plan.move_to(centre, 0.7)
        for motor_speed, duration in STROKES:
            speed = plan.joint_speed(motor_speed)
            stroke = np.minimum(speed * duration, 0.3 * plan.excursion())
            for side in (1.0, -1.0, 0.0):
                plan.move_to(centre + side * turn * stroke, top_speed=speed)
    plan.move_to(plan.home, 0.7)
    return plan.finish()


CYCLE = Cycle("slow_reversals", "Reversals of all axes at motor speeds of 4 to 36 rad/s.", build)
