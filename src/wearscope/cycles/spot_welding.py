"""Test-cycle like spot welding: rows of short hops between spots, slow approaches, long fast transfers."""

import numpy as np

from wearscope.cycles.base import Cycle, Reference
from wearscope.cycles.motion import MotionPlan
from wearscope.robots.model import RobotModel

# Shares of each axis's range: start of each row; hop to the next spot; approach of the gun to a spot.
ROWS = ((0.8, -0.3, 0.4, 0.5, 0.4, 0.6, 0.4), (-0.8, 0.4, -0.4, -0.5, -0.4, -0.6, -0.4))
HOP = (0.05, 0.10, -0.12, 0.08, 0.10, -0.08, 0.08)
APPROACH = (0.02, 0.04, 0.05, 0.0, -0.04, 0.0, 0.03)
SPOTS = 4


def build(model: RobotModel, dwell: float, step: float) -> Reference:
    """Visit two rows of four spots, with a fast transfer before each row and a slow approach to each spot."""
    plan = MotionPlan(model, dwell, step)
    hop, approach = np.array(HOP), np.array(APPROACH)
    for row in ROWS:
        for spot in range(SPOTS):
            above = np.array(row) + spot * hop
            plan.move_to(plan.posture_at(above), 1.0 if spot == 0 else 0.4)
            plan.move_to(plan.posture_at(above + approach), 0.08)
            plan.move_to(plan.posture_at(above), 0.08)
    plan.move_to(plan.home, 1.0)
    return plan.finish()


CYCLE = Cycle("spot_welding", "Rows of spots: short hops, slow approaches, long fast transfers.", build)
