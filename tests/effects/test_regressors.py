"""Every effect's regressors against a formula written here, with known numbers."""

import math

import numpy as np
import pytest

from wearscope import plugins
from wearscope.effects.base import Signals, decay, load_effect
from wearscope.robots.dynamics import Payload

J = 1


def dahl(s: Signals, displacement: float) -> np.ndarray:
    """Exact solution of dz/dt = v (1 - sign(v) z)/displacement over each sample, less the direction."""
    z, out = 0.0, []
    for v, sign in zip(s.v[:, J], s.sign[:, J], strict=True):
        z = sign - (sign - z) * np.exp(-abs(v) * s.dt / displacement)
        out.append(z - sign)
    return np.array(out)[:, None]


def balancer(q: np.ndarray, angle: float, ratio: float) -> np.ndarray:
    """Sine, cosine, constant, and the torque of a constant force between two pins less a sine."""
    base = np.array([np.cos(angle), np.sin(angle)])
    link = ratio * np.column_stack([np.cos(q), np.sin(q)])
    apart = link - base
    lever = (link[:, 0] * apart[:, 1] - link[:, 1] * apart[:, 0]) / np.linalg.norm(apart, axis=1)
    more = (lever - ratio * np.sin(q - angle)) / ratio**2
    return np.column_stack([np.sin(q), np.cos(q), 0 * q + 1, more])


def friction(s: Signals) -> np.ndarray:
    v, sign, T, f = s.v[:, J], s.sign[:, J], s.temperature[:, J], s.wear[:, J]
    bump = np.exp(-((np.abs(v) / (-0.2 + 0.01 * T)) ** 1.3)) * sign
    worn = f * np.exp(-((np.abs(v) / (0.004 * f)) ** 1.3)) * sign
    return np.column_stack([sign, bump, T * bump, v, T * v, worn, f * v])


def warming(s: Signals, speed: float, slope: float, power: float, reference: float) -> np.ndarray:
    v, sign, T = s.v[:, J], s.sign[:, J], s.temperature[:, J]
    warm, still = (sign * np.exp(-((np.abs(v) / (speed + slope * x)) ** power)) for x in (T, reference))
    return np.column_stack([warm - still, T * warm - reference * still, (T - reference) * v])


# Shape parameters and the regressors at joint J, one a coefficient.
FORMULAS = {
    "rotor_inertia": ((), lambda s: s.a[:, [J]]),
    "rotor_inertia_error": ((), lambda s: s.a[:, [J]]),
    "coulomb": ((), lambda s: s.sign[:, [J]]),
    "viscous": ((), lambda s: s.v[:, [J]]),
    "torque_offset": ((), lambda s: np.ones((len(s.t), 1))),
    "friction_wear_temperature": ((-0.2, 0.01, 0.004, 1.3), friction),
    "stribeck": ((0.3, 1.7), lambda s: np.exp(-((np.abs(s.v[:, [J]]) / 0.3) ** 1.7)) * s.sign[:, [J]]),
    "coulomb_asymmetry": ((), lambda s: np.where(s.v[:, [J]] != 0.0, 1.0, 0.0)),
    "viscous_asymmetry": ((), lambda s: s.sign[:, [J]] * s.v[:, [J]]),
    "quadratic_viscous": ((), lambda s: s.sign[:, [J]] * s.v[:, [J]] ** 2),
    "concave_viscous": (
        (0.4, 0.7),
        lambda s: s.sign[:, [J]] * (s.sign[:, [J]] * s.v[:, [J]]) / np.hypot(s.v[:, [J]], 0.7) ** 0.6,
    ),
    "load_dependent_friction": (
        (0.4,),
        lambda s: (
            (s.load[:, [J]] ** 2) ** 0.5
            * s.sign[:, [J]]
            * np.column_stack([np.ones(len(s.v)), np.exp(-np.abs(s.v[:, J]) / 0.4)])
        ),
    ),
    "temperature_dependent_friction": (
        (33.0, 0.04),
        lambda s: (
            (1.0 - np.exp(-0.04 * (s.temperature[:, [J]] - 33.0)))
            / 0.04
            * np.column_stack([s.sign[:, J], s.v[:, J]])
        ),
    ),
    "warm_up_drift": (
        (1.7,),
        lambda s: np.exp(-s.t / 1.7)[:, None] * np.column_stack([s.sign[:, J], s.v[:, J]]),
    ),
    "presliding_hysteresis": ((0.05,), lambda s: dahl(s, 0.05)),
    "torque_ripple": ((25.0,), lambda s: np.column_stack([np.cos(25 * s.q[:, J]), np.sin(25 * s.q[:, J])])),
    "joint_spring": ((), lambda s: np.column_stack([s.q[:, J], np.ones(len(s.t))])),
    "gravity_counterbalance": ((4.0, 0.3), lambda s: balancer(s.q[:, J], 4.0, 0.3)),
    "cross_coupling": ((2.0,), lambda s: np.column_stack([s.v[:, 2], s.sign[:, 2], s.a[:, 2]])),
    "wear": ((0.004, 1.3), lambda s: friction(s)[:, 5:]),
    "friction_temperature": ((0.02, 0.001, 1.3, 41.0), lambda s: warming(s, 0.02, 0.001, 1.3, 41.0)),
    "torque_constant_error": ((), lambda s: s.torque[:, [J]]),
}
# Tested below, each in its own way.
OTHERS = {
    "rigid_body", "backlash", "joint_elasticity", "payload_error", "inertial_error", "time_delay", "unknown"
}  # fmt: skip


def test_every_effect_has_a_formula():
    assert set(FORMULAS) | OTHERS == set(plugins.list_names("effects", "EFFECT"))


@pytest.mark.parametrize("name", sorted(FORMULAS))
def test_regressors_are_the_formula(name, signals):
    shape, formula = FORMULAS[name]
    effect = load_effect(name)
    columns = effect.columns(signals, J, np.array(shape, dtype=float))
    assert columns.shape == (len(signals.t), len(effect.coefficients))
    expected = formula(signals)
    assert np.ptp(expected, axis=0).max() > 0.5 or name in ("torque_offset", "coulomb_asymmetry")
    np.testing.assert_allclose(columns, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_a_concave_law_whose_speed_is_nothing_is_a_power_of_the_speed(signals):
    signals.v[:5, J] = 0.0
    columns = load_effect("concave_viscous").columns(signals, J, np.array([0.4, 0.0]))
    np.testing.assert_allclose(columns[:, 0], np.abs(signals.v[:, J]) ** 0.4 * signals.sign[:, J], rtol=1e-9)


@pytest.mark.parametrize(
    "name",
    sorted(
        set(FORMULAS) - {"viscous_asymmetry", "quadratic_viscous", "concave_viscous", "coulomb_asymmetry"}
    ),
)
def test_regressors_are_the_formula_while_the_direction_changes(name, signals):
    """Between one direction and the other, where a product and a quotient by the direction differ."""
    signals.sign[:] = np.tanh(signals.v / 0.4)
    shape, formula = FORMULAS[name]
    columns = load_effect(name).columns(signals, J, np.array(shape, dtype=float))
    expected = formula(signals)
    np.testing.assert_allclose(columns, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", sorted(set(FORMULAS) - {"torque_constant_error"}))
def test_regressors_belong_to_their_joint(name, signals):
    """Moving another joint's signals changes a joint's regressors only where a coupling says so."""
    shape = np.array(FORMULAS[name][0], dtype=float)
    effect = load_effect(name)
    before = effect.columns(signals, J, shape)
    for x in (signals.q, signals.v, signals.a, signals.sign, signals.load, signals.temperature, signals.wear):
        x[:, 0] = x[::-1, 0] + 0.1
    np.testing.assert_array_equal(effect.columns(signals, J, shape), before)
    for x in (signals.v, signals.a, signals.sign):
        x[:, 2] = x[::-1, 2] + 0.1
    assert np.array_equal(effect.columns(signals, J, shape), before) == (name != "cross_coupling")


# Signal, source, modulator, lowest and highest knot, number of knots; what the spline is over and times.
SPLINES = [
    ((0, 1, 0, -0.5, 0.5, 5), lambda s: (s.q[:, 1], 1.0)),
    ((1, 0, 1, -2.0, 2.0, 9), lambda s: (s.v[:, 0], s.sign[:, J])),
    ((2, 2, 0, -30.0, 40.0, 9), lambda s: (s.a[:, 2], 1.0)),
    ((3, 1, 2, -20.0, -10.0, 5), lambda s: (s.load[:, 1], s.v[:, J])),
    ((4, 1, 1, 30.0, 38.0, 5), lambda s: (s.temperature[:, 1], s.sign[:, J])),
    ((5, 1, 0, 0.0, 4.0, 33), lambda s: (s.t, 1.0)),
]


def fade(x: np.ndarray, low: float, high: float, knots: int) -> np.ndarray:
    """1 between the outer knots, falling linearly to 0 over two spacings beyond them."""
    reach = 2.0 * (high - low) / (knots - 1)
    return np.interp(x, [low - reach, low, high, high + reach], [0.0, 1.0, 1.0, 0.0])


@pytest.mark.parametrize(("shape", "parts"), SPLINES)
def test_unknown_is_a_linear_spline_up_to_its_last_hat(shape, parts, signals):
    *where, low, high, knots = shape
    effect = load_effect("unknown")
    columns = effect.columns(signals, J, np.array([*where, low, high, -1, 0, 0, 1, knots], dtype=float))
    x, factor = parts(signals)
    at = np.linspace(low, high, knots)
    expected = np.zeros_like(columns)
    for k in range(knots):
        expected[:, k] = np.interp(x, at, np.eye(knots)[k]) * factor * fade(x, low, high, knots)
    assert np.any(expected[:, 0]) and np.any(expected[:, knots - 1])
    np.testing.assert_allclose(columns, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("modulator", [0, 1])
def test_unknown_of_two_signals_is_the_product_of_two_splines(modulator, signals):
    shape = [0, 1, modulator, -0.4, 0.4, 3, 2, -3.0, 3.0, 25]
    columns = load_effect("unknown").columns(signals, J, np.array(shape, dtype=float))
    x, y = signals.q[:, 1], signals.load[:, 2]
    factor = fade(x, -0.4, 0.4, 5) * fade(y, -3.0, 3.0, 5) * (signals.sign[:, J] if modulator else 1.0)
    for i in range(5):
        for k in range(5):
            one = np.interp(x, np.linspace(-0.4, 0.4, 5), np.eye(5)[i])
            two = np.interp(y, np.linspace(-3.0, 3.0, 5), np.eye(5)[k])
            np.testing.assert_allclose(columns[:, 5 * i + k], one * two * factor, atol=1e-12)
    assert not columns[:, 25:].any() and np.all(np.any(columns[:, [4, 12, 20, 24]], axis=0))


def test_rigid_body_regressors_give_its_torque(signals, body):
    columns = load_effect("rigid_body").columns(signals, J, np.zeros(0))
    np.testing.assert_allclose(columns @ body.inertial_parameters, signals.load[:, J], atol=1e-9)


def test_payload_error_is_what_another_payload_changes(signals, body):
    values = {"mass": 1.5, "moment_x": 0.3, "moment_y": -0.15, "moment_z": 0.06}
    com = (0.2, -0.1, 0.04)
    inertia = np.array(com)[:, None] * np.array(com)
    about_origin = 1.5 * (np.trace(inertia) * np.eye(3) - inertia)
    for name in ("xx", "xy", "yy", "xz", "yz", "zz"):
        values[f"inertia_{name}"] = about_origin["xyz".index(name[0]), "xyz".index(name[1])]
    loaded = body.with_payload(Payload(1.5, com))
    change = loaded.inverse_dynamics(signals.q, signals.v, signals.a) - signals.load
    torque = load_effect("payload_error").torque(signals, 2, values)
    np.testing.assert_allclose(torque, change, atol=1e-9 * np.abs(change).max())


def test_inertial_error_is_what_other_links_change(signals, body):
    parameters = body.inertial_parameters.reshape(3, 10).copy()
    parameters[0, 6] += 0.2
    parameters[1, 0] += 1.5
    parameters[1, 1] += 0.4
    parameters[2, 9] -= 0.005
    values = {"inertia_yy_1": 0.2, "mass_2": 1.5, "moment_x_2": 0.4, "inertia_zz_3": -0.005}
    other = body.with_inertial_parameters(parameters.ravel())
    change = other.inverse_dynamics(signals.q, signals.v, signals.a) - signals.load
    effect = load_effect("inertial_error")
    torque = effect.torque(signals, 2, values)
    np.testing.assert_allclose(torque, change, atol=1e-9 * np.abs(change).max())
    sized = effect.for_robot(3)
    assert sized.columns(signals, 2, np.zeros(0)).shape == (len(signals.t), 3, len(sized.coefficients))


@pytest.mark.parametrize(
    ("name", "shape", "bend"),
    [
        ("joint_elasticity", (), lambda torque: torque),
        ("backlash", (15.0,), lambda torque: 0.5 * np.tanh(torque / 15.0)),
    ],
)
def test_deflection_is_the_change_of_inverse_dynamics_along_it(name, shape, bend, signals, body):
    """Against inverse dynamics along the link's motion, which lags the motor by a small deflection."""
    small = 1e-7
    lag = np.zeros_like(signals.q)
    lag[:, J] = small * bend(signals.load[:, J])
    moved = [signals.q, signals.v, signals.a]
    for k in range(3):
        moved[k] = moved[k] - lag
        lag = np.gradient(lag, signals.dt, axis=0, edge_order=2)
    change = (body.inverse_dynamics(*moved) - signals.load) / small
    columns = load_effect(name).columns(signals, J, np.array(shape, dtype=float))[:, :, 0]
    inner = slice(20, -20)
    scale = np.abs(change[inner]).max()
    np.testing.assert_allclose(columns[inner], change[inner], atol=0.01 * scale)


def test_delay_is_the_torque_s_slope_and_its_shift_about_a_known_lag(signals):
    angle = 2.0 * np.pi * 0.9 * signals.t
    signals.torque = np.column_stack([0 * angle, np.sin(angle), 0 * angle])
    effect = load_effect("time_delay")
    slope = effect.columns(signals, J, np.zeros(0))[:, 0]
    inner = slice(20, -20)
    np.testing.assert_allclose(slope[inner], -2 * np.pi * 0.9 * np.cos(angle)[inner], atol=0.02)
    lag = 0.03
    signals.lag = np.array([0.0, lag, 0.0])
    shifted = effect.columns(signals, J, np.zeros(0))[:, 0] * lag + np.sin(angle)
    np.testing.assert_allclose(shifted[inner], np.sin(angle - 2 * np.pi * 0.9 * lag)[inner], atol=1e-6)


def test_wear_is_what_eq_17_adds_to_its_wear_free_part(signals):
    law = {"eta0": 3.0, "eta1": -4.0, "eta2": 0.2, "eta3": -0.2, "eta4": 0.01, "eta5": 8.0, "eta6": -0.05,
           "eta7": 0.3, "eta8": 0.004, "eta9": 0.05, "alpha": 1.3}  # fmt: skip
    whole, part = load_effect("friction_wear_temperature"), load_effect("wear")
    free = {**law, "eta7": 0.0, "eta9": 0.0}
    worn = {name: law[name] for name in ("eta7", "eta8", "eta9", "alpha")}
    signals.sign[:] = np.tanh(signals.v / 0.1)
    for joint in range(3):
        torque = whole.torque(signals, joint, law)
        added = part.torque(signals, joint, worn)
        np.testing.assert_allclose(
            torque, whole.torque(signals, joint, free) + added, atol=1e-13 * np.abs(torque).max()
        )
        assert np.any(added) == bool(signals.wear[0, joint])


def test_wear_has_the_form_of_the_contract(signals):
    f, v = signals.wear[:, 2], signals.v[:, 2]
    expected = (0.3 * f * np.exp(-np.abs(v) / (0.004 * f)) + 0.05 * f * np.abs(v)) * np.sign(v)
    torque = load_effect("wear").torque(signals, 2, {"eta7": 0.3, "eta8": 0.004, "eta9": 0.05})
    np.testing.assert_allclose(torque, expected, rtol=1e-12)


@pytest.mark.parametrize("power", [1.0, 1.0 + 1e-12, 2.0, 0.5])
def test_the_stribeck_curve_falls_with_any_power(power):
    for ratio in (0.0, 0.3, 1.0, 4.0):
        assert decay(ratio, power) == pytest.approx(math.exp(-math.pow(ratio, power)), rel=1e-10)
