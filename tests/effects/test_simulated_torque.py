"""Every effect, switched on in the simulator, changes the torque by what its regressor predicts."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import signal
from urdf_texts import Joint, describe_robot

from wearscope import plugins
from wearscope.cycles.base import Reference
from wearscope.effects.base import Signals, load_effect
from wearscope.robots.model import make_model
from wearscope.simulation.plant import build_plant
from wearscope.simulation.sensors import record
from wearscope.simulation.study import trace_forward

URDF = describe_robot(
    Joint("turn", "0 0 1", 40, "0 0 0.2", "1.5 1.4 1.0"),
    Joint("lift", "0 1 0", 20, "0.35 0.02 0", "0.2 1.3 1.2", "0.1 0 0.4"),
    Joint("slide", "0 0 1", 8, "0 0 -0.2", "0.1 0.1 0.03", "0.7 0 0", "prismatic"),
)
JOINTS = ["turn", "lift", "slide"]
STEP = 2e-4
TEMPERATURE, WEAR = 45.0, 20.0

# Parameters at which the effect is about as large as the friction that every joint has.
CASES = {
    "coulomb": ("lift", {"level": 20.0}),
    "viscous": ("slide", {"slope": 25.0}),
    "torque_offset": ("turn", {"offset": 15.0}),
    "friction_wear_temperature": (
        "lift",
        {"eta0": 10.0, "eta1": -8.0, "eta2": 0.5, "eta3": -0.2, "eta4": 0.01, "eta5": 8.0, "eta6": -0.05,
         "eta7": 0.3, "eta8": 0.004, "eta9": 0.05},
    ),
    "stribeck": ("turn", {"level": 15.0, "speed": 0.3, "exponent": 1.4}),
    "coulomb_asymmetry": ("lift", {"half_difference": 6.0}),
    "viscous_asymmetry": ("lift", {"half_difference": 5.0}),
    "quadratic_viscous": ("turn", {"curvature": 8.0}),
    "concave_viscous": ("slide", {"level": 12.0, "exponent": 0.5}),
    "load_dependent_friction": ("lift", {"coefficient": 0.15}),
    "temperature_dependent_friction": ("turn", {"coulomb_slope": 0.8, "viscous_slope": 0.4}),
    "warm_up_drift": ("turn", {"coulomb_drift": 12.0, "viscous_drift": 8.0, "time_constant": 1.5}),
    "presliding_hysteresis": ("slide", {"level": 12.0, "displacement": 0.02}),
    "backlash": ("lift", {"lost_motion": 1e-2, "mesh_torque": 120.0}),
    "joint_elasticity": ("lift", {"compliance": 4e-5}),
    "torque_ripple": ("slide", {"cosine": 6.0, "sine": -9.0, "wavenumber": 40.0}),
    "joint_spring": ("turn", {"stiffness": 60.0, "preload": 5.0}),
    "gravity_counterbalance": ("lift", {"sine1": 50.0, "cosine1": -90.0, "bias": 10.0}),
    "payload_error": ("slide", {"mass": 2.5, "moment_x": 0.3, "moment_z": -0.4}),
    "inertial_error": (
        "slide",
        {"mass_2": 3.0, "moment_x_2": 0.9, "moment_y_2": -0.4, "inertia_yy_2": 0.3, "inertia_zz_1": 0.8,
         "mass_3": 1.5},
    ),
    "wear": ("turn", {"eta7": 0.5, "eta8": 0.004, "eta9": 0.3}),
    "friction_temperature": (
        "turn",
        {"eta1": -9.0, "eta2": 0.5, "eta6": 0.2, "eta3": 0.05, "eta4": 0.01, "reference": 30.0},
    ),
    "rotor_inertia": ("turn", {"inertia": 9.0}),
    "rotor_inertia_error": ("turn", {"inertia": 3.0}),
    "torque_constant_error": ("lift", {"gain": 0.05}),
    "time_delay": ("lift", {"delay": 4e-3}),
    "cross_coupling": ("slide", {"viscous": 6.0, "coulomb": 9.0, "inertia": 3.0, "other": 1}),
    "unknown": ("turn", {"height0": 5.0, "height3": -6.0, "height7": 7.0, "low": -0.6, "high": 0.6}),
}  # fmt: skip
# Relative RMS difference from the regressor. Discretisation leaves 0.1 to 0.3 %; deflections and lags are
# regressors to first order only.
TOLERANCE = {"backlash": 0.1, "joint_elasticity": 0.08, "time_delay": 0.01}
DEFLECTIONS = ("backlash", "joint_elasticity")


def arm(*effects: tuple[str, str, dict]):
    """Three joints with friction and rotors, and further effects; one that is listed replaces its default."""
    rotors = dict(zip(JOINTS, (6.0, 8.0, 5.0), strict=True))
    base = [(joint, "coulomb", {"level": 12.0}) for joint in JOINTS]
    base += [(joint, "viscous", {"slope": 9.0}) for joint in JOINTS]
    base += [(joint, "rotor_inertia", {"inertia": rotors[joint]}) for joint in JOINTS]
    entries = [{"joint": j, "effect": e, "parameters": p} for j, e, p in [*base, *effects]]
    fields = {"name": "arm", "urdf": "arm.urdf", "joints": JOINTS, "effects": entries}
    return make_model({**fields, "drive": {"torque_limit": [2e3, 2e3, 2e3]}}, URDF)


@cache
def motion() -> Reference:
    t = np.arange(0.0, 2.5, STEP)
    omega, phase = 2.0 * np.pi * np.array([0.55, 0.8, 0.7]), np.array([0.3, 1.0, 2.0])
    size, angle = np.array([0.6, 0.5, 0.2]), t[:, None] * omega + phase
    return Reference(t, size * np.sin(angle), size * omega * np.cos(angle), -size * omega**2 * np.sin(angle))


def signals_of(model, trace) -> Signals:
    """What an ideal drive would measure."""
    q, v = trace.q[:-1], trace.v
    a = np.diff(trace.q, 2, axis=0) / STEP**2
    a = np.vstack([a[:1], a])
    body = model.rigid_body(model.declared_payload)
    load = body.inverse_dynamics(q, v, a)
    signals = Signals.along(trace.t, v, q, a, load, TEMPERATURE, WEAR)
    return replace(signals, rigid_body=body, torque=load.copy())


def torque_of(model, signals: Signals) -> np.ndarray:
    """Torque (N, n) that a model's effects predict along signals."""
    torque = signals.load.copy()
    for entry in model.effects:
        effect = load_effect(entry.effect)
        joint = model.joints.index(entry.joint)
        part = effect.torque(signals, joint, entry.parameters)
        if effect.spread:
            torque += part
        else:
            torque[:, joint] += part
    return torque


def test_every_effect_has_a_case():
    names = set(plugins.list_names("effects", "EFFECT")) - {"rigid_body"}
    assert set(CASES) == names


@pytest.mark.parametrize("name", sorted(CASES))
def test_simulated_torque_is_what_the_regressor_predicts(name):
    joint, values = CASES[name]
    column = JOINTS.index(joint)
    without, model = arm(), arm((joint, name, values))
    trace, dt = trace_forward(model, motion(), without, TEMPERATURE, WEAR)
    plant = build_plant(model)
    none = np.zeros(3)
    recorded = record(trace, dt, 1.0 / dt, none, none, plant.torque_gain, plant.torque_delay, None).tau
    signals = signals_of(without, trace)
    predicted = torque_of(without, signals)
    signals.torque = predicted
    effect = load_effect(name)
    part = effect.torque(signals, column, values)
    expected = part if effect.spread else np.zeros_like(predicted)
    if not effect.spread:
        expected[:, column] = part
    change = recorded - predicted
    off = change - expected
    if name in DEFLECTIONS:
        # A gear rings after a reversal; its regressor holds below its resonance.
        low_pass = signal.butter(2, 8.0, fs=1.0 / dt, output="sos")
        off, expected = (signal.sosfiltfilt(low_pass, x, axis=0) for x in (off, expected))
    # Friction at rest has no regressor, and the derivative of a torque none at a jump; the first steps settle
    # the controller.
    reversal = np.any(np.diff(np.sign(trace.v), axis=0, append=0.0) != 0.0, axis=1)
    around = int(12e-3 / dt) if name == "time_delay" else 2
    kept = ~np.convolve(reversal, np.ones(2 * around + 1), "same").astype(bool)
    margin = int((0.3 if name in DEFLECTIONS else 0.1) / dt)
    kept[:margin] = False
    kept[-margin:] = False
    assert np.mean(kept) > 0.7
    off, size = off[kept], np.sqrt(np.mean(expected[kept, column] ** 2))
    assert size > 0.4
    error = np.sqrt(np.mean(off**2, axis=0))
    assert np.all(error < TOLERANCE.get(name, 0.005) * size), (error, size)
