"""A user's own test-cycle: two short moves of all axes and back."""

import numpy as np

from wearscope.cycles.base import Cycle, Reference
from wearscope.cycles.motion import MotionPlan
from wearscope.robots.model import RobotModel


def build(model: RobotModel, dwell: float, step: float) -> Reference:
    """Out at half speed, back slowly."""
    plan = MotionPlan(model, dwell, step)
    plan.move_to(plan.posture_at(0.3 * np.ones(7)), 0.5)
    plan.move_to(plan.home, 0.2)
    return plan.finish()


CYCLE = Cycle("short_moves", "Two short moves of all axes.", build)
