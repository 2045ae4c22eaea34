"""Test-cycle in the style of ISO 9283: centre and four corners of an inclined plane, at three speeds."""

from wearscope.cycles.base import Cycle, Reference
from wearscope.cycles.motion import MotionPlan
from wearscope.robots.model import RobotModel

# Shares of each axis's range. In the standard the poses P1 (centre) to P5 lie on an inclined plane in a cube
# of the workspace; here the cube is in joint space. Axes 2 and 3 move in opposite directions, so that the arm
# does not stretch at a corner.
POSES = (
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (-0.7, -0.6, 0.6, -0.6, 0.6, 0.7, 0.6),
    (0.7, -0.6, 0.6, 0.6, 0.6, -0.7, -0.6),
    (0.7, 0.6, -0.6, 0.6, -0.6, 0.7, 0.6),
    (-0.7, 0.6, -0.6, -0.6, -0.6, -0.7, -0.6),
)
# Share of the speed limits, and size of the plane. The speeds are those of the standard; slower passes use a
# smaller plane, as they would take too long otherwise.
PASSES = ((1.0, 1.0), (0.5, 0.7), (0.1, 0.2))
ORDER = (4, 3, 2, 1, 0)


def build(model: RobotModel, dwell: float, step: float) -> Reference:
    """Visit the poses P5 to P1 at each of the three speeds."""
    plan = MotionPlan(model, dwell, step)
    for speed, size in PASSES:
        for pose in ORDER:
            plan.move_to(plan.posture_at([size * share for share in POSES[pose]]), speed)
    return plan.finish()


CYCLE = Cycle(
    "iso_poses", "Five poses as in ISO 9283, visited at full, half and a tenth of the rated speed.", build
)
