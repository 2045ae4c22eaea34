"""Rigid-body dynamics against an independent engine and against themselves."""

import pickle
from pathlib import Path

import mujoco
import numpy as np
import pytest
from urdf_texts import Joint, describe_robot

from wearscope.robots.dynamics import Payload, RigidBody
from wearscope.robots.model import load_model

ROBOTS = Path(__file__).parents[2] / "config" / "robots"
SLIDE = describe_robot(Joint("slide", "0 0 1", 95.1, kind="prismatic", limits="-0.1 0.5 400 1"))
PAYLOAD = Payload(7.0, (0.1, -0.2, 0.3), (0.5, 0.02, -0.01, 0.4, 0.03, 0.6))


@pytest.fixture(scope="module", params=["medium", "large"])
def model(request):
    return load_model(request.param, ROBOTS)


@pytest.fixture(scope="module")
def motion():
    return np.random.default_rng(4).normal(size=(3, 25, 6))


def mujoco_torque(body, q, v, a):
    engine = mujoco.MjModel.from_xml_string(body.urdf_text())
    engine.opt.gravity = body.gravity
    state = mujoco.MjData(engine)
    order = [engine.joint(name).dofadr[0] for name in body.names]
    torque = np.empty_like(q)
    for row in range(len(q)):
        state.qpos[order], state.qvel[order], state.qacc[order] = q[row], v[row], a[row]
        mujoco.mj_inverse(engine, state)
        # What MuJoCo's soft joint limits would add is no part of the rigid body.
        torque[row] = (state.qfrc_inverse + state.qfrc_constraint)[order]
    return torque


def test_inverse_dynamics_agrees_with_mujoco(model, motion):
    body = model.rigid_body()
    expected = mujoco_torque(body, *motion)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(body.inverse_dynamics(*motion), expected, atol=1e-11 * scale)


def test_one_sample_is_a_row(model, motion):
    body = model.rigid_body()
    rows = body.inverse_dynamics(*motion)
    np.testing.assert_array_equal(body.inverse_dynamics(*(x[3] for x in motion)), rows[3])


def test_mass_matrix_and_bias_give_the_torque(model, motion):
    body = model.rigid_body(PAYLOAD)
    q, v, a = (x[0] for x in motion)
    mass = body.mass_matrix(q)
    assert np.array_equal(mass, mass.T) and np.linalg.eigvalsh(mass)[0] > 0.0
    np.testing.assert_allclose(
        mass @ a + body.bias(q, v), body.inverse_dynamics(q, v, a), rtol=1e-11, atol=1e-8
    )


def test_regressors_give_the_torque(model, motion):
    body = model.rigid_body(PAYLOAD)
    links = body.inertial_regressor(*motion)
    payload = body.payload_regressor(*motion)
    assert links.shape == (25, 6, 60) and payload.shape == (25, 6, 10)
    torque = body.inverse_dynamics(*motion)
    np.testing.assert_allclose(
        links @ body.inertial_parameters + payload @ PAYLOAD.parameters,
        torque,
        atol=1e-12 * np.abs(torque).max(),
    )
    np.testing.assert_array_equal(body.inertial_regressor(*(x[2] for x in motion)), links[2])
    np.testing.assert_array_equal(body.payload_regressor(*(x[2] for x in motion)), payload[2])
    np.testing.assert_array_equal(links[:, :, -10:], payload)


def test_a_payload_changes_the_torque_and_can_be_taken_off(model, motion):
    bare = model.rigid_body()
    loaded = bare.with_payload(PAYLOAD)
    assert not np.allclose(loaded.inverse_dynamics(*motion), bare.inverse_dynamics(*motion))
    np.testing.assert_array_equal(
        loaded.with_payload(None).inverse_dynamics(*motion), bare.inverse_dynamics(*motion)
    )
    twice = bare.with_payload(PAYLOAD.scaled(2.0)).inverse_dynamics(*motion)
    once = loaded.inverse_dynamics(*motion)
    empty = bare.inverse_dynamics(*motion)
    np.testing.assert_allclose(twice - empty, 2.0 * (once - empty), atol=1e-11 * np.abs(once).max())


def test_other_parameters_reach_the_urdf(model, motion):
    body = model.rigid_body(PAYLOAD)
    parameters = body.inertial_parameters
    parameters[10] *= 1.2
    parameters[51:54] += 0.05
    other = body.with_inertial_parameters(parameters)
    expected = (
        body.inertial_regressor(*motion) @ parameters + body.payload_regressor(*motion) @ PAYLOAD.parameters
    )
    scale = np.abs(expected).max()
    np.testing.assert_allclose(other.inverse_dynamics(*motion), expected, atol=1e-12 * scale)
    again = RigidBody(other.urdf_text(), model.joints, model.gravity, PAYLOAD)
    np.testing.assert_allclose(again.inverse_dynamics(*motion), expected, atol=1e-11 * scale)
    assert body.urdf_text() == model.urdf_text, "the robot it came from stays as it was"


def test_a_link_of_no_weight_is_refused(model, refuses):
    parameters = model.rigid_body().inertial_parameters
    parameters[30] = -1.0
    refuses(model.rigid_body().with_inertial_parameters, parameters)


def test_pickling_keeps_everything(model, motion):
    body = model.rigid_body(PAYLOAD).with_inertial_parameters(1.1 * model.rigid_body().inertial_parameters)
    copy = pickle.loads(pickle.dumps(body))
    np.testing.assert_array_equal(copy.inverse_dynamics(*motion), body.inverse_dynamics(*motion))


def test_gravity_follows_the_model(motion):
    q = motion[0][:, :1]
    body = RigidBody(SLIDE, ["slide"], gravity=(0.0, 0.0, -1.62))
    np.testing.assert_allclose(body.inverse_dynamics(q, 0 * q, 0 * q + 0.5), 95.1 * (0.5 + 1.62), rtol=1e-13)
    assert body.mass_matrix([0.1])[0, 0] == pytest.approx(95.1)


@pytest.mark.parametrize("samples", [0, 1, 7])
def test_samples_together_give_the_bytes_of_each_alone(model, motion, samples):
    q, v, a = (x[:samples] for x in motion)
    for body, rows in (
        (model.rigid_body(PAYLOAD), (q, v, a)),
        (RigidBody(SLIDE, ["slide"]), (q[:, :1], v[:, :1], a[:, :1])),
    ):
        torque = body.inverse_dynamics(*rows)
        assert torque.shape == rows[0].shape
        for k in range(samples):
            np.testing.assert_array_equal(torque[k], body.inverse_dynamics(*(x[k] for x in rows)))


def test_a_raw_urdf_is_refused(refuses):
    refuses(RigidBody, SLIDE, ["slide", "turn"])


def test_what_links_have_more_is_the_regressor_times_it(model, motion):
    body = model.rigid_body(PAYLOAD)
    more = np.random.default_rng(5).normal(size=60)
    more[10] = -50.0  # a refit may leave a link less than nothing
    expected = body.inertial_regressor(*motion) @ more
    found = body.add_to_links(more, *motion)
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_array_equal(body.add_to_links(0.0 * more, *motion), 0.0 * found)
