"""Generated motions keep to a robot's limits, and their file gives them again."""

import numpy as np
import pytest

from wearscope.cycles.base import check_reference, load_cycle
from wearscope.cycles.planned import KINDS, PlannedMotion, write_cycle
from wearscope.robots.model import load_model


@pytest.fixture(scope="module")
def medium():
    # Moves of all joints at their full acceleration ask for more torque than this robot has.
    model = load_model("config/robots/medium")
    drive = model.drive.model_dump(exclude_none=True)
    return model.replace(drive=drive | {"torque_limit": [20 * x for x in drive["torque_limit"]]})


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("joint", [None, 1])
def test_motions_keep_to_the_limits_and_move_what_they_say(medium, kind, joint):
    motion = PlannedMotion(kind, joint, seed=4, pace=0.6, size=0.7, seconds=20.0)
    reference = motion.build(medium, 0.05, 0.004)
    check_reference(reference, medium, motion.name)
    moves = np.ptp(reference.q, axis=0) > 1e-9
    assert moves.all() if joint is None or kind in ("postures", "points", "fourier") else moves.sum() == 1
    assert moves[1]
    again = motion.build(medium, 0.05, 0.004)
    np.testing.assert_array_equal(reference.q, again.q)
    assert np.abs(reference.v).max(axis=0)[1] <= 0.6 * medium.motion_limits()[0][1] * (1 + 1e-6)


def test_drawn_motions_differ_by_seed(medium):
    for kind in ("points", "fourier"):
        one, other = (PlannedMotion(kind, seed=s, seconds=12.0).build(medium, 0.0, 0.01) for s in (1, 2))
        assert np.ptp(one.q - other.q[: len(one.q)] if len(one.q) <= len(other.q) else 1.0) > 0.0


def test_the_file_gives_the_planned_motion_on_a_robot_with_other_limits(medium, tmp_path):
    planned = PlannedMotion("points", seed=2, seconds=10.0).plan_within(medium)
    file = tmp_path / "next.py"
    file.write_text(write_cycle(planned, medium.joints, "Tells a from b."))
    slower = medium.replace(
        drive=medium.drive.model_dump(exclude_none=True) | {"speed_limit": [0.5] * medium.n}
    )
    built = load_cycle(str(file)).build(slower, 0.05, 0.004)
    np.testing.assert_array_equal(built.q, planned.build(medium, 0.05, 0.004).q)
