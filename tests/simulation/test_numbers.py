"""Numbers of a robot as conditions of a design point: what they move, and who believes what."""

import numpy as np
import pytest
from simulation.arms import make_arm, rub, stand, swing

from wearscope.cycles.base import Cycle, load_cycle
from wearscope.robots.model import load_model
from wearscope.robots.numbers import Number, set_numbers
from wearscope.simulation.feasibility import check_cycle, check_robot, check_screening, screen_factors
from wearscope.simulation.study import Conditions, make_conditions, simulate_point

ARM = make_arm(
    rub(), sensors={"torque_noise": [1.0] * 4, "sample_rate": 250.0}, controller={"bandwidth_hz": 5.0}
)
SWING = swing()


def record(path=None, level=0.0, relative=False, seed=1):
    numbers = () if path is None else ((Number(path, relative), level),)
    return simulate_point(ARM, SWING, Conditions(numbers=numbers), seed)


@pytest.fixture(scope="module")
def plain():
    """The arm with nothing set."""
    return record()


def test_nothing_set_or_nothing_changed_gives_the_same_bytes(plain):
    for same in (record("sensors.torque_noise", 1.0), record("controller.bandwidth_hz", 0.0, True)):
        assert np.array_equal(plain.tau, same.tau) and np.array_equal(plain.q, same.q)


def test_torque_noise_scales_the_noise_alone(plain):
    silent, loud = record(seed=None), record("sensors.torque_noise", 200.0, True)
    assert np.array_equal(loud.q, plain.q)
    assert loud.tau - silent.tau == pytest.approx(3.0 * (plain.tau - silent.tau), abs=1e-9)


def test_what_is_set_is_as_if_the_robot_were_built_so():
    """Friction is not fed forward, and the rotors stay: the whole robot with other friction is the same."""
    sticky = make_arm(
        rub(coulomb=20.0), sensors={"torque_noise": [1.0] * 4, "sample_rate": 250.0},
        controller={"bandwidth_hz": 5.0},
    )  # fmt: skip
    other = simulate_point(sticky, SWING, Conditions(), 1)
    assert np.array_equal(record("effects.coulomb.all.level", 20.0).tau, other.tau)


def test_the_controller_does_not_know_a_heavier_rotor():
    free = make_arm(controller={"bandwidth_hz": 5.0})

    def stray(*numbers):
        run = simulate_point(free, SWING, Conditions(numbers=numbers), None)
        return np.abs(run.q - SWING.q[::4]).max()

    assert stray((Number("drive.rotor_inertia", True), 50.0)) > 100.0 * stray()


def test_the_controller_knows_its_gains(plain):
    stiff = record("controller.bandwidth_hz", 15.0)
    error, usual = (np.abs(one.q - SWING.q[::4]).max() for one in (stiff, plain))
    assert error < 0.5 * usual


def test_an_effect_that_the_model_lacks_is_added_at_a_joint(plain):
    soft = record("effects.joint_elasticity.lift.compliance", 1e-5)
    change = np.abs(soft.tau - plain.tau).max(axis=0)
    assert change.argmax() == ARM.joints.index("lift") and change.max() > 0.1


def test_the_controller_does_not_know_a_heavier_link():
    """What the drives hold beyond what they believe is the link's weight, along the same motion."""
    quiet = make_arm(controller={"bandwidth_hz": 20.0})
    hold = stand(1.0)
    heavy, plain = (
        simulate_point(quiet, hold, Conditions(numbers=numbers), None)
        for numbers in (((Number("links.side.mass"), 25.0),), ())
    )
    still = np.zeros(4)
    weight = quiet.rigid_body().inverse_dynamics(hold.q[0], still, still)
    heavier = set_numbers(quiet, [(Number("links.side.mass"), 25.0)])
    expected = heavier.rigid_body().inverse_dynamics(hold.q[0], still, still) - weight
    assert np.abs(expected).max() > 5.0
    assert (heavy.tau - plain.tau)[-1] == pytest.approx(expected, rel=0.02, abs=0.2)


@pytest.mark.parametrize("rate", [125.0, 90.0, 333.3])
def test_the_sample_rate_changes_how_many_rows_there_are_and_nothing_that_they_sample(rate):
    whole = simulate_point(ARM, SWING, Conditions(), None, sample_rate=1000.0)
    other = record("sensors.sample_rate", rate, seed=None)
    assert len(other.t) == int((len(SWING.t) - 1) * rate / 1000.0) + 1
    assert np.diff(other.t) == pytest.approx(1.0 / rate)
    for name, scale in (("q", 3e-6), ("qd", 1e-3), ("tau", 0.05)):
        for j in range(4):
            expected = np.interp(other.t, whole.t, getattr(whole, name)[:, j])
            assert np.abs(getattr(other, name)[:, j] - expected).max() < scale, name


def test_more_samples_than_steps_are_refused(refuses):
    refuses(record, "sensors.sample_rate", 2000.0)
    refuses(check_robot, ARM, {"rate": ("sensors.sample_rate", 100.0, 300.0)}, 0.004)


def test_the_range_of_a_test_cycle_changes_how_far_it_goes():
    medium = load_model("medium")
    cycle = load_cycle("axis_sweeps")
    reach = []
    for level in (0.0, -60.0):
        smaller = set_numbers(medium, [(Number("upper.axis_3", True), level)])
        reach.append(cycle.build(smaller, 0.05, 0.004).q.max(axis=0))
    assert reach[1][2] < reach[0][2] - 0.1 and np.delete(reach[1] - reach[0], 2) == pytest.approx(
        0.0, abs=1e-9
    )
    ranges = {"range": ("upper.axis_3 %", -60.0, 0.0)}
    assert check_cycle(medium, cycle, "axis_sweeps", ranges, 0.004) > 1.0


def test_kinds_of_factors_become_conditions(refuses):
    kinds = {"f": "wear", "n": "sensors.torque_noise %", "d": "detectors.A.bins", "w4": "dwell"}
    made = make_conditions({"f": 5.0, "n": 20.0, "d": 3.0, "w4": 50.0}, kinds)
    assert made.wear == (5.0,) and made.numbers == ((Number("sensors.torque_noise", True), 20.0),)
    refuses(make_conditions, {"f": 1.0}, {"f": "sound"})


def test_numbers_are_screened_by_simulating_both_ends(refuses):
    cycle = Cycle("swing", "The swing.", lambda model, dwell, step: swing(dt=step))
    ranges = {
        "noise": ("sensors.torque_noise %", -50.0, 50.0),
        "gear": ("drive.gear_ratio", 50.0, 100.0),
        "own": ("detectors.A.bins", 5.0, 9.0),
        "load": ("links.lift.mass %", -10.0, 10.0),
        "rate": ("sensors.sample_rate", 100.0, 250.0),
    }
    table = screen_factors(ARM, {"swing": cycle}, ranges, 0.002).set_index("factor")
    moving = {"noise", "own", "load", "rate"}
    assert table["moves"].to_dict() == {name: name in moving for name in ranges}
    assert np.isnan(table.loc["own", "change"])
    refuses(check_screening, table.reset_index(), "arm", [])
