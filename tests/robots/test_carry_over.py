"""Wear and temperature carried over: what is lent, how it is scaled, and where it is refused."""

import numpy as np
import pytest

from wearscope.effects.base import Signals, load_effect
from wearscope.robots.friction import carry_over, find_lacking, friction_torque, scale_parameters
from wearscope.robots.model import load_model, save_model

WHOLE = "friction_wear_temperature"


@pytest.fixture(scope="module")
def medium():
    return load_model("medium")


def entry(joint, effect, **values):
    return {"joint": joint, "effect": effect, "parameters": values, "source": "fitted"}


@pytest.fixture(scope="module")
def plain(medium):
    """The robot with Coulomb and viscous friction alone, as a closed loop leaves it."""
    effects = []
    for own in medium.effects:
        p = own.parameters
        effects.append(entry(own.joint, "coulomb", level=p["eta0"]))
        effects.append(entry(own.joint, "viscous", slope=p["eta5"] + 50.0 * p["eta6"]))
    return medium.replace(effects=effects, name="plain")


def along(values, speed, temperature, wear, effect):
    t = np.arange(len(speed), dtype=float)
    signals = Signals.along(t, speed[:, None], temperature=temperature, wear=wear)
    return load_effect(effect).torque(signals, 0, values)


@pytest.mark.parametrize("temperature", [30.0, 50.0, 68.0])
@pytest.mark.parametrize("wear", [0.0, 1.0, 37.0])
def test_the_parts_of_eq_17_add_up_to_the_whole(medium, temperature, wear):
    p = medium.effects[1].parameters
    speed = np.linspace(-1.5, 1.5, 61)
    reference = 41.0
    still = {"eta0": p["eta0"], "eta1": p["eta1"], "eta2": p["eta2"], "eta3": p["eta3"], "eta4": p["eta4"]}
    still |= {"eta5": p["eta5"], "eta6": p["eta6"], "alpha": p["alpha"], "eta8": p["eta8"]}
    parts = along(still, speed, reference, 0.0, WHOLE)
    kept = {name: p[name] for name in ("eta1", "eta2", "eta3", "eta4", "eta6", "alpha")}
    parts = parts + along(kept | {"reference": reference}, speed, temperature, 0.0, "friction_temperature")
    worn = {name: p[name] for name in ("eta7", "eta8", "eta9", "alpha")}
    parts = parts + along(worn, speed, temperature, wear, "wear")
    np.testing.assert_allclose(parts, along(p, speed, temperature, wear, WHOLE), atol=1e-9)


def test_a_plain_model_gets_wear_where_it_wears_and_temperature_everywhere(plain, medium):
    made = carry_over(plain, medium)
    assert find_lacking(plain) and not find_lacking(made)
    added = [one for one in made.effects if one.assumed]
    assert {one.joint for one in added if one.effect == "wear"} == set(medium.wear_joints)
    assert {one.joint for one in added if one.effect == "friction_temperature"} == set(medium.joints)
    assert all("carried over from" in one.source for one in added)
    assert [one for one in made.effects if not one.assumed] == list(plain.effects)


def test_the_scaled_friction_is_the_lender_s_with_torque_and_speed_scaled(medium):
    """A joint twice as strong with half the gear: every part of its friction must be so too."""
    effect = load_effect(WHOLE)
    p = medium.effects[0].parameters
    scaled = scale_parameters(effect, p, speed=2.0, torque=3.0)
    speed = np.linspace(-3.0, 3.0, 41)
    np.testing.assert_allclose(
        along(scaled, 2.0 * speed, 62.0, 21.0, WHOLE), 3.0 * along(p, speed, 62.0, 21.0, WHOLE), rtol=1e-12
    )


def test_wear_follows_the_joint_s_own_friction(plain, medium):
    strong = plain.replace(
        effects=[
            entry(one.joint, one.effect, **{name: 2.0 * value for name, value in one.parameters.items()})
            for one in plain.effects
        ]
    )
    first, second = (carry_over(model, medium, ["wear"]) for model in (plain, strong))
    for a, b in zip(first.effects, second.effects, strict=True):
        if a.assumed:
            for name in ("eta7", "eta9"):
                assert b.parameters[name] == pytest.approx(2.0 * a.parameters[name], rel=1e-12)
            assert b.parameters["eta8"] == a.parameters["eta8"]


def test_what_was_identified_stays(plain, medium):
    own = entry(
        "axis_2", "temperature_dependent_friction", coulomb_slope=0.1, viscous_slope=-0.2, reference=47
    )
    model = plain.replace(effects=[*plain.to_mapping()["effects"], own])
    made = carry_over(model, medium)
    assert not any(one.assumed and one.joint == "axis_2" and one.effect != "wear" for one in made.effects)
    whole = carry_over(medium, medium)
    assert whole.effects == medium.effects


def test_wear_moves_the_completed_model_and_not_the_plain_one(plain, medium):
    made = carry_over(plain, medium)
    speed = np.array([0.05, 0.8])
    for joint in range(3):
        for level, temperature in ((50.0, 50.0), (0.0, 30.0)):
            nothing = friction_torque(plain, joint, speed, temperature, level)
            assert np.array_equal(nothing, friction_torque(plain, joint, speed, 50.0, 0.0))
            assert np.all(
                friction_torque(made, joint, speed, temperature, level)
                != friction_torque(made, joint, speed, 50.0, 0.0)
            )


def test_the_file_says_what_is_assumed(plain, medium, tmp_path):
    made = carry_over(plain, medium)
    save_model(made, tmp_path / "made.yaml")
    again = load_model(tmp_path / "made.yaml")
    assert again.effects == made.effects
    assert "assumed: true" in (tmp_path / "made.yaml").read_text()


def test_a_robot_without_wear_lends_none(plain, refuses):
    refuses(carry_over, plain, plain)


def test_a_joint_without_friction_is_refused(plain, medium, refuses):
    bare = plain.replace(effects=[one for one in plain.to_mapping()["effects"] if one["joint"] != "axis_3"])
    refuses(carry_over, bare, medium, ["wear"])
