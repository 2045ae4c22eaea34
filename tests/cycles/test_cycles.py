"""The six test-cycles, on the study's robots and on robots of other shapes."""

import inspect
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from urdf_texts import Joint, describe_robot

from wearscope.cycles import periodic_excitation
from wearscope.cycles.base import check_reference, list_cycles, load_cycle
from wearscope.errors import InputError
from wearscope.robots.model import load_model, make_model

ROBOTS = Path(__file__).parents[2] / "config" / "robots"
CYCLES = [
    "axis_sweeps",
    "iso_poses",
    "periodic_excitation",
    "point_to_point",
    "slow_reversals",
    "spot_welding",
]
STEP = 0.002


@pytest.fixture(scope="module", params=["medium", "large"])
def model(request):
    return load_model(request.param, ROBOTS)


@pytest.fixture(scope="module", params=CYCLES)
def cycle(request):
    return load_cycle(request.param)


@pytest.fixture(scope="module")
def reference(model, cycle):
    return cycle.build(model, 0.05, STEP)


def chain(n, prismatic=False):
    """Robot of n joints, the last one continuous, with limits chosen for each."""
    kinds = ["prismatic" if prismatic else "revolute"] * (n - 1) + ["continuous"]
    body = {"mass": 3, "com": "0 0 0.1", "moments": "0.1 0.1 0.1", "at": "0 0 0.2", "limits": "-0.3 0.5 9 2"}
    axes = ["0 0 1", "0 1 0"]
    joints = [Joint(f"j{k}", axes[k % 2], kind=kind, **body) for k, kind in enumerate(kinds, 1)]
    return make_model(
        {
            "name": f"chain{n}",
            "urdf": "chain.urdf",
            "joints": [f"j{k}" for k in range(1, n + 1)],
            "drive": {"speed_limit": [2.0] * n, "acceleration_limit": [8.0] * n, "jerk_limit": [80.0] * n},
        },
        describe_robot(*joints),
    )


def test_the_room_holds_these_cycles():
    assert list_cycles() == CYCLES


def test_name_and_file_agree(cycle):
    assert Path(inspect.getfile(cycle.build)).stem == cycle.name
    assert cycle.description.endswith(".")


def test_lasts_10_to_25_seconds(model, cycle):
    for dwell in (0.025, 0.075):
        assert 10.0 <= cycle.build(model, dwell, STEP).t[-1] <= 25.0


def test_the_robot_can_follow(reference, model, cycle):
    check_reference(reference, model, cycle.name)


def test_jerk_stays_within_its_limit(reference, model):
    jerk = np.diff(reference.a, axis=0) / STEP
    assert np.all(np.abs(jerk).max(axis=0) <= model.motion_limits()[2])


def test_rates_are_derivatives(reference, model):
    _, acceleration, jerk = model.motion_limits()
    for values, rate, bound in (
        (reference.q, reference.v, acceleration),
        (reference.v, reference.a, jerk),
    ):
        error = np.abs((values[2:] - values[:-2]) / (2.0 * STEP) - rate[1:-1])
        assert np.all(error.max(axis=0) < 0.5 * bound * STEP)


def test_starts_and_ends_at_rest_at_home(reference, model):
    for row in (0, -1):
        np.testing.assert_allclose(reference.v[row], 0.0, atol=1e-9)
        np.testing.assert_allclose(reference.a[row], 0.0, atol=1e-9)
    np.testing.assert_allclose(reference.q[0], model.home_posture, atol=1e-12)
    np.testing.assert_array_equal(reference.t, STEP * np.arange(len(reference.t)))


def test_dwell_is_the_pause_before_each_move(model, cycle):
    short, long = (cycle.build(model, dwell, STEP) for dwell in (0.025, 0.075))
    moving = [np.any(np.abs(r.v) > 1e-9, axis=1) for r in (short, long)]
    moves = [int(np.sum(np.diff(m.astype(int)) == 1)) for m in moving]
    assert moves[0] == moves[1] >= 3
    # One pause a move and one at the end.
    assert long.t[-1] - short.t[-1] == pytest.approx(0.05 * (moves[0] + 1), abs=2 * STEP)
    assert np.argmax(moving[0]) == pytest.approx(0.025 / STEP, abs=2)
    assert np.sum(moving[0]) == pytest.approx(np.sum(moving[1]), abs=2 * moves[0])


def test_first_three_axes_move_at_several_speeds_both_ways(reference, model):
    for joint in range(3):
        speed = np.abs(reference.v[:, joint] * model.gear_ratio[joint])
        share = [np.mean((speed >= low) & (speed < high)) for low, high in ((1, 15), (15, 50), (50, 400))]
        assert min(share[:2]) > 0.01 and max(speed) > 50.0
        assert reference.v[:, joint].min() < 0.0 < reference.v[:, joint].max()


def test_some_cycle_dwells_in_both_speed_bands_of_axes_1_to_3(model):
    for name in ("axis_sweeps", "point_to_point"):
        speed = np.abs(load_cycle(name).build(model, 0.05, STEP).v * model.gear_ratio)[:, :3]
        assert np.all(np.mean((speed > 1) & (speed < 50), axis=0) > 0.05)
        assert np.all(np.mean((speed > 50) & (speed < 280), axis=0) > 0.05)


def test_is_deterministic_and_refines_with_the_step(model, cycle, reference):
    again = cycle.build(model, 0.05, STEP)
    for key in "tqva":
        np.testing.assert_array_equal(getattr(again, key), getattr(reference, key))
    fine = cycle.build(model, 0.05, STEP / 2).q[::2]
    rows = min(len(fine), len(reference.q))
    assert abs(len(fine) - len(reference.q)) <= 2
    np.testing.assert_allclose(fine[:rows], reference.q[:rows], atol=1e-9)


@pytest.mark.parametrize(("n", "prismatic"), [(1, False), (2, True), (4, False), (7, False), (8, False)])
def test_fits_robots_of_other_shapes(cycle, n, prismatic):
    robot = chain(n, prismatic)
    check_reference(cycle.build(robot, 0.05, 0.005), robot, cycle.name)


def test_sweeps_move_one_axis_at_a_time(model):
    moving = np.abs(load_cycle("axis_sweeps").build(model, 0.05, STEP).v) > 1e-9
    assert np.all(moving[:, :3].sum(axis=1) <= 1)
    assert not np.any(moving[:, :3].any(axis=1) & moving[:, 3:].any(axis=1))


@pytest.mark.parametrize(("dwell", "step"), [(-0.1, 0.001), (float("nan"), 0.001), (0.05, 0.0)])
def test_impossible_times_are_refused(cycle, model, dwell, step):
    with pytest.raises(InputError, match="give a dwell of 0 or more and a step above 0"):
        cycle.build(model, dwell, step)


def test_a_motion_that_the_planner_knows_no_code_for_gets_one_sentence():
    """Ruckig's binding raises `ValueError` for a code that it has no name for."""
    robot = chain(2)
    slow = robot.drive.model_dump() | {"speed_limit": [1e-4] * 2, "acceleration_limit": [1e3] * 2}
    robot = robot.replace(drive=slow | {"jerk_limit": [1e6] * 2})
    with pytest.raises(InputError, match="change its home posture or its limits a little"):
        load_cycle("point_to_point").build(robot, 0.05, 1.0)


def test_a_joint_without_range_sets_no_limit_of_the_excitation():
    limits = SimpleNamespace(n=2, speed=np.full(2, 2.0), acceleration=np.full(2, 8.0), jerk=np.full(2, 80.0))
    alone, both = (
        periodic_excitation._find_frequency(limits, np.array(one)) for one in ((0.3, 0.0), (0.3, 0.3))
    )
    assert 0.0 < both <= alone < np.inf
