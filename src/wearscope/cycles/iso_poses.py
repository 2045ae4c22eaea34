"""Pose cycle in the style of ISO 9283: the centre and four corners of an inclined plane, at three speeds."""

from wearscope.cycles.base import Cycle, Reference
from wearscope.cycles.motion import MotionPlan
from wearscope.robots.model import RobotModel

# The standard's poses P1 (centre) to P5 lie on a plane through a cube; here the cube is one of joint space.
# Axes 2 and 3 incline the plane against each other, so that the arm does not stretch at a corner.
POSES = (
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (-0.7, -0.6, 0.6, -0.6, 0.6, 0.7, 0.6),
    (0.7, -0.6, 0.6, 0.6, 0.6, -0.7, -0.6),
    (0.7, 0.6, -0.6, 0.6, -0.6, 0.7, 0.6),
    (-0.7, 0.6, -0.6, -0.6, -0.6, -0.7, -0.6),
)
# The standard tests at 100, 50 and 10 % of the rated speed; the slow pass is made on a smaller plane.
PASSES = ((1.0, 1.0), (0.5, 0.7), (0.1, 0.2))
ORDER = (4, 3, 2, 1, 0)


def build(model: RobotModel, dwell: float, step: float) -> Reference:
    """P5 to P1 at each of the three speeds."""
    plan = MotionPlan(model, dwell, step)
    for speed, size in PASSES:
        for pose in ORDER:
            plan.move_to(plan.posture_at([size * share for share in POSES[pose]]), speed)
    return plan.finish()


CYCLE = Cycle(
    "iso_poses", "Five poses as in ISO 9283, visited at full, half and a tenth of the rated speed.", build
)
