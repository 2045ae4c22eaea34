"""What effects say of themselves is complete, and fits the columns that they give."""

from dataclasses import replace

import numpy as np
import pytest

from wearscope.effects import effect as motions
from wearscope.effects.base import Effect, Parameter, Signals, load_effect
from wearscope.effects.effect import USUAL
from wearscope.effects.vocabulary import (
    TITLES,
    candidate_effects,
    empirical_effect,
    given_effects,
    list_effects,
    plain_friction,
    session_effects,
    thermal_friction,
    worn_effect,
)
from wearscope.robots.fields import Drive
from wearscope.simulation.plant import STATED_BY_DRIVE

EFFECTS = {effect.name: effect for effect in list_effects()}
CONTRACT = {
    "rigid_body", "rotor_inertia", "coulomb", "viscous", "torque_offset", "friction_wear_temperature",
    "stribeck", "coulomb_asymmetry", "viscous_asymmetry", "quadratic_viscous", "concave_viscous",
    "load_dependent_friction", "temperature_dependent_friction", "warm_up_drift", "presliding_hysteresis",
    "backlash", "joint_elasticity", "torque_ripple", "joint_spring", "gravity_counterbalance",
    "payload_error", "rotor_inertia_error", "torque_constant_error", "time_delay", "cross_coupling", "wear",
    "inertial_error", "unknown",
}  # fmt: skip


def load(*names: str) -> list[Effect]:
    return [load_effect(name) for name in names]


def names_of(effects) -> set[str]:
    return {effect.name for effect in effects}


#: A part of eq. (17), as `wear` is one: carried over to models that lack it, never in a verdict.
PARTS = {"friction_temperature"}


def test_the_vocabulary_is_that_of_the_contract():
    assert set(EFFECTS) == CONTRACT | PARTS


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_names_that_an_effect_refers_to_exist(effect):
    known = set(EFFECTS)
    assert {*effect.parents, *effect.contains} <= known
    assert not effect.corrects or effect.corrects in known
    assert effect.name not in {*effect.parents, *effect.contains}


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_every_candidate_says_which_motion_shows_it(effect):
    sentences = {value for name, value in vars(motions).items() if name.isupper() and isinstance(value, str)}
    assert effect.excitation in sentences
    if effect.candidate:
        assert effect.excitation != motions.OTHERS


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_believable_bounds_lie_within_those_of_physics(effect):
    for p in effect.for_robot(2).parameters:
        for unit in ("rad", "m"):
            low, high = p.bounds(unit)
            assert p.lower <= low < high <= p.upper


def test_bounds_depend_on_the_joint_s_unit():
    (lost_motion,) = EFFECTS["backlash"].coefficients
    assert lost_motion.bounds("rad") == (0.0, 6e-3)
    assert lost_motion.bounds("m") == (0.0, 1e-3)
    (gain,) = EFFECTS["torque_constant_error"].coefficients
    assert gain.bounds("rad") == gain.bounds("m") == (-0.15, 0.15)
    (level,) = EFFECTS["coulomb"].coefficients
    assert level.bounds("m") == (0.0, np.inf)


def test_a_gear_for_small_loads_may_be_softer():
    """As far as a gear may be slack, and never less than the softest that are sold."""
    (compliance,) = EFFECTS["joint_elasticity"].coefficients
    assert compliance.bounds("rad") == compliance.bounds("rad", load=50.0) == (0.0, 5e-3)
    assert compliance.bounds("rad", load=0.2) == (0.0, pytest.approx(0.03))
    assert compliance.bounds("m", load=2.0) == (0.0, pytest.approx(5e-4))
    assert compliance.bounds("rad", load=0.0) == (0.0, compliance.upper)
    (level,) = EFFECTS["coulomb"].coefficients
    assert level.bounds("rad", load=0.2) == (0.0, np.inf)


@pytest.mark.parametrize(
    ("outer", "shape"),
    [
        ("friction_wear_temperature", (0.3, 0.0, 0.004, 1.0)),
        ("joint_spring", ()),
        ("gravity_counterbalance", (3.0, 0.25)),
        ("inertial_error", ()),
    ],
)
def test_what_an_effect_contains_is_in_its_span(outer, shape, signals):
    """At the contained one's shape that belongs to the outer one's."""
    effect = EFFECTS[outer].for_robot(3)
    inner_shapes = {
        "stribeck": (0.3, 1.0),
        "temperature_dependent_friction": (33.0, 0.0),
        "wear": (0.004, 1.0),
    }
    span = effect.columns(signals, 1, np.array(shape, dtype=float)).reshape(len(signals.t), -1)
    if effect.spread:
        span = effect.columns(signals, 1, np.zeros(0)).reshape(-1, len(effect.coefficients))
    scale = np.maximum(np.linalg.norm(span, axis=0), 1e-12)
    for name in effect.contains:
        inner = EFFECTS[name]
        x = inner.columns(signals, 1, np.array(inner_shapes.get(name, ()), dtype=float))
        x = x.reshape(len(span), -1)
        if name == "temperature_dependent_friction":
            # A law with a temperature dependence of its own is not asked for another one of the level.
            x = x[:, 1:]
        left = x - span / scale @ np.linalg.lstsq(span / scale, x, rcond=1e-12)[0]
        assert np.linalg.norm(left, axis=0).max() < 1e-8 * np.linalg.norm(x, axis=0).max(), name


def test_a_joint_spring_is_not_contained_in_a_counterbalance(signals):
    signals.q[:] *= 4.0
    span = EFFECTS["gravity_counterbalance"].columns(signals, 1, np.array([3.0, 0.25]))
    x = signals.q[:, 1]
    left = x - span @ np.linalg.lstsq(span, x, rcond=None)[0]
    assert np.linalg.norm(left) > 0.02 * np.linalg.norm(x)
    assert "joint_spring" not in EFFECTS["gravity_counterbalance"].contains


@pytest.mark.parametrize(("angle", "ratio", "free"), [(0.7, 0.25, 0.6), (4.0, 0.45, 0.9), (2.0, 0.1, 0.0)])
def test_a_spring_between_two_pins_is_a_counterbalance(signals, angle, ratio, free):
    """Its torque is the derivative of its energy by the position."""

    def energy(q):
        length = np.hypot(np.cos(angle) - ratio * np.cos(q), np.sin(angle) - ratio * np.sin(q))
        return 40.0 * (length - free) ** 2

    signals.q[:] *= 4.0
    effect, q = EFFECTS["gravity_counterbalance"], signals.q[:, 1]
    torque = (energy(q + 1e-5) - energy(q - 1e-5)) / 2e-5
    span = effect.columns(signals, 1, np.array([angle, ratio]))
    beta = np.linalg.lstsq(span, torque, rcond=None)[0]
    assert np.abs(torque - span @ beta).max() < 1e-6 * np.abs(torque).max()
    assert beta[2] == pytest.approx(0.0, abs=1e-6 * np.abs(torque).max())
    assert beta[3] == pytest.approx(-80.0 * free * ratio**2, rel=1e-4, abs=1e-4)


def test_standard_effects_are_those_of_a_plain_joint():
    standard = [effect for effect in list_effects() if effect.standard]
    assert names_of(standard) == {"rotor_inertia", "coulomb", "viscous", "torque_offset"}
    assert all(not effect.parents for effect in standard)
    assert empirical_effect().name == "unknown"


def test_nothing_declared_leaves_everything_that_is_no_error_of_a_declaration():
    found = names_of(candidate_effects([], [], (), 3))
    never = {"rigid_body", "friction_wear_temperature", "friction_temperature", "unknown", "wear"}
    assert found == CONTRACT - never - {"rotor_inertia_error", "inertial_error"}


def test_errors_of_given_values_are_candidates_where_they_are_given():
    declared = load("rigid_body", "rotor_inertia")
    names = lambda *given: names_of(candidate_effects(declared, [], given, 3))  # noqa: E731
    assert not {"rotor_inertia_error", "inertial_error"} & names()
    assert "rotor_inertia_error" in names("rotor_inertia")
    assert {"rotor_inertia_error", "inertial_error"} <= names("rotor_inertia", "rigid_body")
    assert "rotor_inertia" not in names("rotor_inertia")
    # A rigid body that nobody declared is in the model all the same.
    assert "inertial_error" in names_of(candidate_effects([], [], ["rigid_body"], 3))
    assert names_of(given_effects(declared, {"rotor_inertia", "urdf"})) == {"rotor_inertia"}
    assert given_effects(declared, {"urdf"}) == []


def test_effects_that_a_drive_states_are_installed_from_it():
    assert EFFECTS.keys() & Drive.model_fields.keys() == names_of(STATED_BY_DRIVE)


def test_a_declared_law_leaves_nothing_of_what_it_contains():
    found = names_of(candidate_effects(load("friction_wear_temperature"), [], (), 3))
    assert not found & set(EFFECTS["friction_wear_temperature"].contains)


def test_a_refinement_waits_for_its_parent():
    stribeck, drift = EFFECTS["stribeck"], EFFECTS["warm_up_drift"]
    assert not stribeck.has_parent([]) and not stribeck.has_parent(load("viscous", "torque_offset"))
    assert stribeck.has_parent(load("coulomb"))
    assert drift.has_parent(load("viscous"))
    assert stribeck.has_parent(load("friction_wear_temperature"))
    assert EFFECTS["time_delay"].has_parent([])


def test_complexity_counts_coefficients_and_fitted_shapes():
    counts = {
        "coulomb": 1, "stribeck": 2, "concave_viscous": 2, "torque_ripple": 3, "cross_coupling": 1,
        "temperature_dependent_friction": 2, "warm_up_drift": 2, "backlash": 2, "payload_error": 4,
    }  # fmt: skip
    for name, count in counts.items():
        assert EFFECTS[name].complexity(EFFECTS[name].subsets()[0]) == count, name


def test_a_body_counts_as_a_mass_and_three_moments_whatever_a_fit_chooses_of_it():
    """Further links concerned, and which of them; so an error of one link is no simpler than a payload."""
    payload, links = EFFECTS["payload_error"], EFFECTS["inertial_error"].for_robot(6)
    assert {payload.complexity(one) for one in payload.subsets()} == {4}
    names = [p.name for p in links.coefficients]
    plain = [[names.index(name) for name in one] for one in links.variants]
    full = [[names.index(name) for name in one] for one in links.extensions]
    assert [links.complexity(one) for one in plain] == [5] * 6
    assert sorted(links.complexity(one) for one in full) == [5] * 6 + [25] * 2
    assert links.complexity(plain[0] + plain[5]) == 9
    alone = EFFECTS["inertial_error"].for_robot(1)
    assert alone.complexity(alone.subsets()[0]) == 4


def test_wrong_links_are_asked_one_by_one_then_together():
    effect = EFFECTS["inertial_error"].for_robot(3)
    assert effect is EFFECTS["inertial_error"].for_robot(3)
    names = [p.name for p in effect.coefficients[20:24]]
    assert names == ["mass_3", "moment_x_3", "moment_y_3", "moment_z_3"]
    assert [list(s) for s in effect.plain_subsets()] == [[10 * k + i for i in range(4)] for k in range(3)]


def test_effects_apply_where_the_signals_hold_what_they_need(signals):
    warm = EFFECTS["temperature_dependent_friction"]
    assert warm.is_usable(signals, 1)
    signals.temperature[:, 1] = 30.0 + 0.4 * np.linspace(0, 1, len(signals.t))
    assert not warm.is_usable(signals, 1)
    signals.temperature[:, 1] = np.linspace(0, 9, len(signals.t))
    signals.temperature[7, 1] = np.nan
    assert not warm.is_usable(signals, 1)
    assert warm.is_usable(signals, 2)
    assert EFFECTS["cross_coupling"].is_usable(signals, 0)


def test_signals_are_named_by_joint():
    joints = ["one", "two", "three"]
    assert EFFECTS["stribeck"].name_signals((0.1, 1.0), joints, 1) == ["qd_two", "sign_qd_two"]
    coupling = EFFECTS["cross_coupling"].name_signals((2.0,), joints, 1)
    assert coupling == ["qd_three", "sign_qd_three", "qdd_three"]
    unknown = EFFECTS["unknown"]
    assert unknown.name_signals((3, 0, 1, 0, 1, -1, 0, 0, 1, 5), joints, 1) == ["load_one", "sign_qd_two"]
    both = unknown.name_signals((0, 1, 0, 0, 1, 5, 0, 0, 1, 25), joints, 1)
    assert both == ["q_two", "t"]


def test_eq_17_holds_where_its_stribeck_speed_is_positive():
    law = EFFECTS["friction_wear_temperature"]
    assert law.temperatures({"eta3": -0.2, "eta4": 0.01}) == (pytest.approx(20.0), np.inf)
    assert law.temperatures({"eta3": 0.5, "eta4": -0.01}) == (-np.inf, pytest.approx(50.0))
    assert law.temperatures({"eta3": 0.1}) == (-np.inf, np.inf)
    low, high = law.temperatures({"eta3": 0.0})
    assert low > high
    assert EFFECTS["coulomb"].temperatures({}) == (-np.inf, np.inf)


def test_a_parameter_without_a_default_must_be_given(refuses):
    law = EFFECTS["friction_wear_temperature"]
    refuses(law.check_values, {"eta0": 1.0}, "here")
    law.check_values({"eta0": 1.0, "eta3": 0.1}, "here")


def test_parameters_of_links_are_checked_by_the_robot_s_size(refuses):
    effect = EFFECTS["inertial_error"].for_robot(2)
    effect.check_values({"mass_2": 1.0}, "here")
    refuses(effect.check_values, {"mass_3": 1.0}, "here")


def test_own_effects_of_one_name_are_refused(refuses):
    own = [
        Effect("drag", "k v", (Parameter("k", "1"),), "x", ("qd_{joint}",), reference=f"{place}/drag.py")
        for place in "ab"
    ]
    assert "drag" in names_of(candidate_effects([], own[:1], (), 2))
    refuses(candidate_effects, [], own, (), 2)


def test_selections_name_effects_of_the_vocabulary():
    assert len(session_effects()) == len({effect.name for effect in session_effects()}) > 0
    assert EFFECTS.keys() >= TITLES.keys() | USUAL
    assert worn_effect().needs_wear and worn_effect() in session_effects()
    assert thermal_friction().is_thermal and thermal_friction().candidate
    assert {effect.name for effect in plain_friction()} == {"coulomb", "viscous"}


PASSIVE = {
    "coulomb": {"level": 7.0},
    "viscous": {"slope": 3.0},
    "quadratic_viscous": {"curvature": 2.0},
    "joint_spring": {"stiffness": 50.0, "preload": -4.0},
    "friction_wear_temperature": {
        f"eta{k}": value for k, value in enumerate((6.0, -1.0, 0.1, 0.05, 0.01, 5.0, 0.25))
    },
    "temperature_dependent_friction": {
        "coulomb_slope": 0.3,
        "viscous_slope": -0.1,
        "reference": 25.0,
        "rate": 0.03,
    },
    "stribeck": {"level": 4.0, "speed": 0.8, "exponent": 1.0},
    "torque_ripple": {"cosine": 1.5, "sine": -0.5, "wavenumber": 6.0},
    "load_dependent_friction": {"coefficient": 0.2},
}
#: Friction with a memory is no function of position and speed; tests/export replay it.
WITH_MEMORY = {"presliding_hysteresis"}


def test_what_a_passive_joint_holds_is_the_effect_s_torque_without_wear():
    assert {name for name, effect in EFFECTS.items() if effect.passive} == PASSIVE.keys() | WITH_MEMORY
    t = np.linspace(0.0, 1.0, 101)
    q, v = 0.3 + np.sin(5.0 * t)[:, None], 5.0 * np.cos(5.0 * t)[:, None]
    load = 20.0 * np.cos(q)
    signals = Signals.along(t, v, q, load=load, temperature=40.0)
    for name, given in PASSIVE.items():
        effect = EFFECTS[name]
        values = {p.name: p.default if p in effect.shape else 0.0 for p in effect.parameters} | given
        held = effect.passive(values, 40.0)
        torque = held.get("friction", 0.0) * np.sign(v) + held.get("damping", 0.0) * v
        torque += held.get("quadratic", 0.0) * v * np.abs(v)
        torque += held.get("by_load", 0.0) * np.abs(load) * np.sign(v)
        torque += held.get("stiffness", 0.0) * q + held.get("preload", 0.0)
        level, speed, exponent = held.get("falling", (0.0, 1.0, 1.0))
        torque += level * np.exp(-(np.abs(v / speed) ** exponent)) * np.sign(v)
        cosine, sine, wavenumber = held.get("wave", (0.0, 0.0, 1.0))
        torque += cosine * np.cos(wavenumber * q) + sine * np.sin(wavenumber * q)
        np.testing.assert_allclose(effect.torque(signals, 0, values), torque[:, 0], atol=1e-12, err_msg=name)


@pytest.mark.parametrize("value", [-3.0, 4.0, float("nan")])
def test_a_parameter_beyond_its_bounds_is_refused(value, refuses):
    effect = Effect("own", "k", (Parameter("k", "N m", -2.0, 3.0),), "x", ("q_{joint}",))
    refuses(effect.check_values, {"k": value}, "here")


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_an_effect_whose_columns_change_with_the_directions_says_so(effect, signals):
    turned = replace(signals, sign=0.5 * np.roll(signals.sign, 100, axis=0))
    shapes = effect.shapes(signals, 1)
    shape = shapes[len(shapes) // 2] if len(shapes) else np.zeros(0)
    columns, other = (effect.columns(s, 1, shape) for s in (signals, turned))
    assert np.array_equal(columns, other) or effect.follows_direction
