"""The two robots of the study: their model files recomputed from the numbers that their READMEs state."""

from pathlib import Path

import numpy as np
import pytest
from folders import find_real

from wearscope.robots.dynamics import RigidBody
from wearscope.robots.model import check_effects, load_model
from wearscope.robots.urdf import normalise_urdf

ROBOTS = Path(__file__).parents[2] / "config" / "robots"
MOTOR_TURN = 2.0 * np.pi

MEDIUM_RATIO = np.array([-105, 210, 60, -99, 79.2, -99])
LARGE_RATIO = np.array(
    [256.85714285714283, 267.42857142857144, 252.33333333333334, 221, 239.61904761904762, 154.3231343283582]
)
LARGE_COULOMB = np.array([0.732, 1.832, 1.863, 0.448, 0.413, 0.373])
LARGE_VISCOUS = np.array([0.00148, 0.01068, 0.01068 / 1.832 * 1.863, 0.00192, 0.00163, 0.00221])
# Published: gear ratio, rotor inertia; at the joint: Coulomb torque and viscous slope; motor peak torque.
ROBOT_FIGURES = {
    "medium": (
        MEDIUM_RATIO,
        np.array([0.0013, 0.0013, 0.0013, 1.6e-4, 1.8e-4, 4.3e-5]),
        np.array([0.4 * 105, 0.5 * 210, 0.7 * 60, 21.8, 30.1, 10.9]),
        np.array([0.13 / 160 * 105**2, 0.1 / 130 * 210**2, 0.2 / 130 * 60**2, 9.8, 0.03, 3.92]),
        np.array([10.45, 10.45, 10.45, 4, 5, 2]),
    ),
    "large": (
        LARGE_RATIO,
        np.array([0.00923, 0.0118, 0.0118, 0.00173, 0.00173, 0.00173]),
        LARGE_COULOMB * LARGE_RATIO,
        LARGE_VISCOUS * LARGE_RATIO**2,
        np.array([40, 40, 40, 12, 12, 12]),
    ),
}


@pytest.fixture(scope="module", params=["medium", "large"])
def named(request):
    return load_model(request.param, ROBOTS), ROBOT_FIGURES[request.param]


def friction_parameters(ratio, coulomb, viscous):
    """Eq. (17) at one joint, made as config/robots/medium/README.md says."""
    temperature = np.linspace(30.0, 70.0, 401)
    law = 1.30e-4 + 1.32e-3 * np.exp(-temperature / 20.71)
    slope, start = np.polyfit(temperature, law, 1)
    largest, scale, gear = coulomb / 3.11e-2, viscous / (start + 40.0 * slope), abs(ratio)
    return {
        "eta0": coulomb,
        "eta1": -2.50e-2 * largest,
        "eta2": 1.60e-3 * largest,
        "eta3": -24.81 / gear,
        "eta4": 0.98 / gear,
        "eta5": start * scale,
        "eta6": slope * scale,
        "eta7": 1e-3 * largest,
        "eta8": 0.4 / gear,
        "eta9": 5e-6 * scale,
        "alpha": 1.0,
    }


def test_drive_train(named):
    model, (ratio, rotor, _, _, peak) = named
    np.testing.assert_allclose(model.gear_ratio, ratio, rtol=1e-5)
    np.testing.assert_allclose(model.rotor_inertia, ratio**2 * rotor, rtol=1e-5)
    np.testing.assert_allclose(model.torque_limit, peak * np.abs(ratio), rtol=1e-5)
    np.testing.assert_allclose(model.torque_noise, 0.0025 * model.torque_limit, rtol=1e-5)
    np.testing.assert_allclose(model.encoder_resolution, MOTOR_TURN / 2**16 / np.abs(ratio), rtol=1e-5)
    _, acceleration, jerk = model.motion_limits()
    np.testing.assert_allclose(jerk, 10.0 * acceleration)


def test_friction(named):
    model, (ratio, _, coulomb, viscous, _) = named
    check_effects(model)
    entries = {e.joint: e for e in model.effects if e.effect == "friction_wear_temperature"}
    assert list(entries) == model.joints
    for joint, name in enumerate(model.joints):
        expected = friction_parameters(ratio[joint], coulomb[joint], viscous[joint])
        assert entries[name].parameters == pytest.approx(expected, rel=1e-5)
        assert "assumed" in entries[name].source
        slope = entries[name].parameters["eta5"] + 40.0 * entries[name].parameters["eta6"]
        assert slope == pytest.approx(viscous[joint], rel=1e-4)


def test_nothing_but_friction_and_balancer(named):
    model, _ = named
    others = [entry.effect for entry in model.effects if entry.effect != "friction_wear_temperature"]
    assert others == (["gravity_counterbalance"] if model.name == "large" else [])


def balancer_torque(q):
    """Hydraulic law of config/robots/large/README.md [N m]."""
    anchor, lever, volume = 0.8, 0.2, 0.48e-3
    area = np.pi / 4.0 * (0.055**2 - 0.030**2)
    theta = q + np.pi / 2.0 + 0.2
    length = np.sqrt(anchor**2 + lever**2 - 2.0 * anchor * lever * np.cos(theta))
    pressure = 2.0 * 0.0795 * 296.8 * 328.0 / (2.0 * volume - area * (length - (anchor - lever)))
    return pressure * area * anchor * lever * np.sin(theta) / length


def test_balancer_is_the_hydraulic_law():
    entry = load_model("large", ROBOTS).effects[-1]
    q = np.radians(np.linspace(-140.0, -5.0, 271))
    p = entry.parameters
    length = np.sqrt(1.0 + p["ratio"] ** 2 - 2.0 * p["ratio"] * np.cos(q - p["angle"]))
    preload = np.sin(q - p["angle"]) * (1.0 / length - 1.0) / p["ratio"]
    fitted = p["bias"] + p["sine1"] * np.sin(q) + p["cosine1"] * np.cos(q) + p["pretension"] * preload
    assert entry.joint == "axis_2"
    assert np.abs(fitted - balancer_torque(q)).max() < 17.0
    assert np.abs(balancer_torque(q)).max() == pytest.approx(8839.0, abs=1.0)


def test_balancer_relieves_axis_2_within_its_limits():
    model = load_model("large", ROBOTS)
    body = model.rigid_body(model.declared_payload)
    for degrees in (-140, -110, -90, -60, -30, -5):
        q = np.array([0.0, np.radians(degrees), np.pi / 2.0, 0.0, 0.0, 0.0])
        holding = body.bias(q, np.zeros(6))
        holding[1] += balancer_torque(q[1])
        assert np.all(np.abs(holding) < 0.5 * model.torque_limit)


def test_medium_mass_and_reach():
    model = load_model("medium", ROBOTS)
    masses = model.rigid_body().inertial_parameters[::10]
    np.testing.assert_allclose(masses, [30, 56.5, 26.4, 28.7, 5.2, 0.5])
    # Upright, the published y coordinates add up and nothing but the offsets acts about the shoulder.
    holding = model.rigid_body().bias(np.zeros(6), np.zeros(6))
    lever = {"wrist": 0.155 * (28.7 + 5.2 + 0.5)}
    assert holding[2] == pytest.approx(9.81 * (lever["wrist"] - 0.05 * 0.5), rel=1e-9)
    assert holding[1] == pytest.approx(holding[2], rel=1e-9)


def test_medium_base_mass_does_not_matter():
    model = load_model("medium", ROBOTS)
    body = model.rigid_body()
    parameters = body.inertial_parameters
    parameters[[0, 4, 6]] *= 3.0
    other = body.with_inertial_parameters(parameters)
    q, v, a = np.random.default_rng(5).normal(size=(3, 10, 6))
    np.testing.assert_allclose(other.inverse_dynamics(q, v, a), body.inverse_dynamics(q, v, a), atol=1e-9)


def test_large_is_the_published_robot():
    joints = [f"a{k}" for k in range(1, 7)]
    published = RigidBody(normalise_urdf(find_real("kr300") / "robot.urdf", joints), joints)
    own = load_model("large", ROBOTS).rigid_body()
    q, v, a = np.random.default_rng(6).normal(size=(3, 30, 6))
    expected = published.inverse_dynamics(q, v, a)
    error = np.abs(own.inverse_dynamics(q, v, a) - expected).max(axis=0)
    assert np.all(error < 1e-4 * np.abs(expected).max(axis=0))
