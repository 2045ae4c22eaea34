"""Friction that falls, has a memory, or goes with the position, in MuJoCo as in the model."""

import json

import mujoco
import numpy as np
import pytest
from single_axis import COULOMB, make_axis

from wearscope.cycles.base import required_torque
from wearscope.cycles.planned import PlannedMotion
from wearscope.export.comparison import compare_replays, replay
from wearscope.export.formats import make_spec, sum_falls, write_isaac_lab, write_mjcf
from wearscope.export.holdings import ISAAC, URDF, take_holdings, without_motors


def passive_torque(model, path):
    """Torque (N,) that MuJoCo's passive motors need along a path, and the friction loss that is left."""
    compiled = mujoco.MjModel.from_xml_string(write_mjcf(model, take_holdings(model, 50.0)))
    assert compiled.nu == 1, "passive motors have no input"
    compiled.opt.timestep = step = 1e-3
    data = mujoco.MjData(compiled)
    found = []
    for q, v in zip(path, np.gradient(path, step), strict=True):
        data.qpos[0], data.qvel[0] = q, v
        mujoco.mj_step(compiled, data)
        found.append(-data.qfrc_actuator[0])
    return np.array(found), compiled.dof_frictionloss[0]


@pytest.mark.parametrize("exponent", [0.5, 1.0, 1.5, 2.0])
def test_friction_falls_as_in_the_model(exponent):
    fall = {"level": 4.0, "speed": 0.2, "exponent": exponent}
    model = make_axis(("coulomb", COULOMB), ("stribeck", fall))
    for speed in (0.01, 0.05, 0.2, 0.6, 1.5):
        found, left = passive_torque(model, speed * 1e-3 * np.arange(4000))
        truth = 3.0 + 4.0 * np.exp(-((speed / 0.2) ** exponent))
        assert left == 0.0
        assert found[-1] == pytest.approx(truth, abs=0.12), speed


def test_friction_with_temperature_is_held_at_one():
    values = {"eta0": 3.0, "eta1": -1.0, "eta2": 0.1, "eta3": -0.3, "eta4": 0.01, "eta5": 1.0, "eta6": 0.02}
    model = make_axis(("friction_wear_temperature", values))
    for speed in (0.01, 0.2, 1.5):
        found, left = passive_torque(model, speed * 1e-3 * np.arange(4000))
        assert left == 0.0
        assert found[-1] == pytest.approx(3.0 + 4.0 * np.exp(-speed / 0.2), abs=0.12), speed
    assert take_holdings(model, 50.0).damping == pytest.approx([2.0])
    # Where the law's bump is not positive, nothing falls.
    assert take_holdings(model, 5.0).falling == {}
    slopes = {"coulomb_slope": -0.02, "viscous_slope": 0.03, "reference": 40.0}
    warm = take_holdings(make_axis(("coulomb", COULOMB), ("temperature_dependent_friction", slopes)), 50.0)
    assert warm.friction == pytest.approx([COULOMB["level"] - 0.2]) and warm.damping == pytest.approx([0.3])


@pytest.mark.parametrize("exponent", [0.5, 1.0, 1.5])
def test_a_fall_is_a_sum_of_falls_with_the_square(exponent):
    x = np.linspace(0.0, 4.0, 50)
    summed = sum(weight * np.exp(-((x / speed) ** 2)) for weight, speed in sum_falls(exponent))
    assert np.abs(summed - np.exp(-(x**exponent))).max() < 0.06
    assert sum(weight for weight, _ in sum_falls(exponent)) == pytest.approx(1.0)


def test_a_wave_goes_with_the_position():
    model = make_axis(("torque_ripple", {"cosine": 0.7, "sine": -0.4, "wavenumber": 12.0}))
    path = np.linspace(-1.0, 1.0, 500)
    found, _ = passive_torque(model, path)
    np.testing.assert_allclose(found, 0.7 * np.cos(12.0 * path) - 0.4 * np.sin(12.0 * path), atol=1e-6)


def test_friction_turns_round_over_its_displacement():
    """Dahl's law after a reversal: z = 2 exp(-x / displacement) - 1 less the way."""
    model = make_axis(("coulomb", COULOMB), ("presliding_hysteresis", {"level": 2.0, "displacement": 0.05}))
    there = np.linspace(0.0, 0.5, 2000)
    found, left = passive_torque(model, np.concatenate([there, there[::-1]]))
    assert left == pytest.approx(1.0)
    moved = 0.5 - there[::-1]
    np.testing.assert_allclose(found[2005:], 2.0 * (2.0 * np.exp(-moved / 0.05) - 1.0)[5:], atol=0.05)


def test_a_joint_with_falling_friction_is_replayed_much_nearer():
    fall = {"level": 4.0, "speed": 0.2, "exponent": 1.0}
    model = make_axis(("coulomb", COULOMB), ("viscous", {"slope": 1.0}), ("stribeck", fall))
    motion = PlannedMotion("points", seed=3, pace=0.7, size=0.8, seconds=8.0).build(model, 0.05, 0.004)
    torque = required_torque(motion, model, 50.0, 0.0, 1.0)
    held = take_holdings(model, 50.0)
    ours = replay(make_spec(model, held), model.joints, motion, torque)
    without = replay(make_spec(model, without_motors(held)), model.joints, motion, torque)
    # Through a rest, no torque alone says when the joint leaves it: after 2 s most replays had one.
    assert without[1, 0] > 0.02
    assert ours[1, 0] < 0.1 * without[1, 0]
    assert ours[2, 0] < 0.2 * without[2, 0]
    found = compare_replays(model, held, motion, 50.0)
    assert found["MJCF"]["axis"]["position"]["2"] == pytest.approx(ours[2, 0])
    assert found["MJCF"]["axis"]["torque"] < found[URDF]["axis"]["torque"]


def test_limits_are_those_of_the_urdf():
    model = make_axis(("coulomb", COULOMB), lower=[-0.3], upper=[0.4])
    compiled = make_spec(model, take_holdings(model, 50.0)).compile()
    np.testing.assert_allclose(compiled.jnt_range[0], [-2.5, 2.2])
    np.testing.assert_allclose(compiled.actuator_ctrlrange[-1], [-90.0, 90.0])


def test_isaac_lab_gets_static_and_dynamic_friction():
    fall = {"level": 4.0, "speed": 0.2, "exponent": 1.0}
    model = make_axis(("coulomb", COULOMB), ("viscous", {"slope": 1.5}), ("stribeck", fall))
    held = take_holdings(model, 50.0)
    assert json.loads(write_isaac_lab(model, held)) == {
        "axis": {
            "armature": 0.5,
            "friction": 7.0,
            "dynamic_friction": 3.0,
            "viscous_friction": 1.5,
            "effort_limit_sim": 90.0,
            "velocity_limit_sim": 2.0,
        }
    }
    lost = {(one.format, one.effect) for one in held.left}
    assert {(URDF, "stribeck"), (ISAAC, "stribeck"), (URDF, "rotor_inertia")} == lost


def test_a_memory_of_more_than_the_coulomb_friction_is_left_out():
    model = make_axis(("coulomb", COULOMB), ("presliding_hysteresis", {"level": 5.0, "displacement": 0.05}))
    held = take_holdings(model, 50.0)
    assert ("MJCF", "presliding_hysteresis") in {(one.format, one.effect) for one in held.left}
    assert make_spec(model, held).compile().dof_frictionloss[0] == pytest.approx(3.0)
