"""A gear that yields, in MuJoCo as in the simulator that moved the same model."""

import json

import mujoco
import numpy as np
import pytest
from single_axis import COULOMB, make_axis

from wearscope.cycles.base import Reference
from wearscope.cycles.planned import PlannedMotion
from wearscope.export.comparison import compare, link_motion, replay
from wearscope.export.formats import make_spec, sum_springs, write_mjcf
from wearscope.export.holdings import ISAAC, URDF, take_holdings, without_motors
from wearscope.export.run import export_model
from wearscope.robots.model import load_model
from wearscope.simulation.balance import deflection
from wearscope.simulation.study import simulate_point

ELASTIC = ("joint_elasticity", {"compliance": 2e-3})
SLACK = ("backlash", {"lost_motion": 0.02, "mesh_torque": 0.5})
MOTION = PlannedMotion("points", seed=3, pace=0.7, size=0.8, seconds=5.0)


@pytest.mark.parametrize("law", [(2e-3, 0.0, 1.0), (1e-4, 0.01, 0.5), (2e-3, 0.02, 3.0)])
def test_springs_add_up_to_the_gear(law):
    torque = np.linspace(0.0, 30.0, 400)
    bend = deflection(torque, *law)
    found = sum(k * np.maximum(bend - band, 0.0) for k, band in sum_springs(*law))
    assert np.abs(found - torque).max() < 0.2 * law[2]


def test_a_held_joint_bends_as_in_the_model():
    model = make_axis(ELASTIC, SLACK)
    compiled = mujoco.MjModel.from_xml_string(write_mjcf(model, take_holdings(model, 50.0)))
    data = mujoco.MjData(compiled)
    for _ in range(6000):
        data.qpos[0], data.qvel[0] = 0.0, 0.0
        data.qfrc_applied[0] = -3.0 * 9.81 * 0.1
        mujoco.mj_step(compiled, data)
    assert data.qpos[1] == pytest.approx(deflection(3.0 * 9.81 * 0.1, 2e-3, 0.02, 0.5), rel=0.02)


@pytest.mark.parametrize("gear", [(ELASTIC,), (ELASTIC, SLACK)])
def test_what_the_simulator_moved_is_replayed_nearer_with_the_gear(gear):
    model = make_axis(("viscous", {"slope": 1.0}), *gear)
    reference = MOTION.build(model, 0.05, 1e-3)
    truth = simulate_point(model, reference, sample_rate=1000.0)
    motion = Reference(truth.t, truth.q, truth.qd, np.gradient(truth.qd, 1e-3, axis=0))
    held = take_holdings(model, 50.0)
    assert not [one for one in held.left if one.format == "MJCF"]
    links = link_motion(model, held, motion)
    ours = replay(make_spec(model, held), model.joints, motion, truth.tau, links)
    rigid = replay(make_spec(model, without_motors(held)), model.joints, motion, truth.tau)
    assert np.all(ours < [[0.5], [0.2], [0.2]] * rigid)


def test_the_export_says_what_a_gear_cannot_be(tmp_path):
    stiff = ("backlash", {"lost_motion": 0.01, "mesh_torque": 0.5})
    model = make_axis(("coulomb", COULOMB), ("load_dependent_friction", {"coefficient": 0.1}), stiff)
    export_model(model, tmp_path, reference=MOTION.build(model, 0.05, 0.01))
    told = json.loads((tmp_path / "export.json").read_text())
    left = {(one["format"], one["effect"]): one["reason"] for one in told["left"]}
    assert "as stiff as a step of 1 ms takes" in left["MJCF", "transmission"]
    for format in (URDF, ISAAC):
        assert left[format, "backlash"] == "its joints have no gear that yields"
    assert "held at one load" in left["MJCF", "load_dependent_friction"]
    assert set(told["replay"]["MJCF"]["axis"]["position"]) == {"0.1", "0.5", "2"}


def test_friction_by_load_is_that_of_the_mean_load():
    model = make_axis(("coulomb", COULOMB), ("load_dependent_friction", {"coefficient": 0.1}))
    motion = MOTION.build(model, 0.05, 0.004)
    load = model.rigid_body().inverse_dynamics(motion.q, motion.v, motion.a)
    held = take_holdings(model, 50.0, np.abs(load).mean(axis=0))
    assert held.friction[0] == pytest.approx(3.0 + 0.1 * np.abs(load).mean())
    bare = take_holdings(model, 50.0, np.zeros(1))
    errors = [compare(model, one, motion, 50.0)["not_held_where_moving"][0] for one in (held, bare)]
    assert errors[0] < 0.7 * errors[1]


def test_a_gear_without_a_rotor_is_left_out():
    drive = {"speed_limit": [1.5], "acceleration_limit": [6.0], "jerk_limit": [60.0]}
    model = make_axis(ELASTIC, drive=drive)
    held = take_holdings(model, 50.0)
    assert ("MJCF", "transmission") in {(one.format, one.effect) for one in held.left}
    assert make_spec(model, held).compile().nv == 1


def test_six_stiff_gears_stay_at_rest_with_their_arm():
    """What is too stiff for the step would make the gears swing ever wider."""
    model = load_model("medium")
    stiff = [
        {"joint": joint, "effect": effect, "parameters": parameters}
        for joint in model.joints
        for effect, parameters in (
            ("joint_elasticity", {"compliance": 1e-9}),
            ("backlash", {"lost_motion": 1e-4, "mesh_torque": 1.0}),
        )
    ]
    model = model.replace(effects=[one.model_dump() for one in model.effects] + stiff)
    compiled = make_spec(model, take_holdings(model, 50.0)).compile()
    data = mujoco.MjData(compiled)
    motors = [int(compiled.joint(name).qposadr[0]) for name in model.joints]
    compiled.dof_damping[[int(compiled.joint(name).dofadr[0]) for name in model.joints]] += 500.0
    widest = []
    for _ in range(1500):
        mujoco.mj_step(compiled, data)
        widest.append(np.abs(np.delete(data.qpos, motors)).max())
    assert max(widest[1000:]) < 0.02 and max(widest[1000:]) < 2.0 * max(widest[:500])


def test_mujoco_needs_the_torque_of_the_links_behind_the_gear():
    model = make_axis(("viscous", {"slope": 1.0}), ELASTIC)
    held = take_holdings(model, 50.0)
    found = compare(model, held, MOTION.build(model, 0.05, 0.004), 50.0)
    assert found["difference"][0] < 1e-6 * found["torque_rms"][0]
    assert found["not_held_where_moving"][0] < 1e-6 * found["torque_rms"][0]
