"""Factors that move no torque: found, refused by name, or dropped."""

import numpy as np
import pandas as pd
import pytest

from wearscope.cycles.base import Cycle, load_cycle
from wearscope.errors import InputError
from wearscope.evaluation.sensitivity import drop_idle
from wearscope.robots.model import load_model
from wearscope.simulation import feasibility
from wearscope.simulation.feasibility import STRIDE, check_screening, screen_factors
from wearscope.simulation.recording import Recording
from wearscope.simulation.study import Conditions, simulate_point

RANGES = {
    "f": ("wear", 0.0, 50.0),
    "w1": ("wear", 0.0, 50.0),
    "w3": ("temperature", 30.0, 70.0),
    "w4": ("dwell", 25.0, 75.0),
    "w5": ("payload_mass_error", -10.0, 10.0),
}
CYCLES = {"point_to_point": load_cycle("point_to_point")}
STEP = 0.002


@pytest.fixture(scope="module")
def medium():
    return load_model("medium")


def plain_friction(model, joints=()):
    """Effects in which the named joints have Coulomb friction alone."""
    return [
        {"joint": one["joint"], "effect": "coulomb", "parameters": {"level": 40.0}}
        if one["joint"] in joints
        else one
        for one in model.to_mapping()["effects"]
    ]


def idle(model):
    table = screen_factors(model, CYCLES, RANGES, STEP)
    return set(table.loc[~table["moves"], "factor"])


def test_every_factor_moves_the_study_s_robot(medium):
    assert idle(medium) == set()


def test_a_payload_s_error_moves_the_torque_by_the_mass_that_is_wrong(medium):
    """What is carried is the declared mass over 1 + error, and the torque is linear in it."""
    model = medium.replace(effects=[])
    whole = CYCLES["point_to_point"].build(model, 0.05, STEP)
    q, v, a = (one[::STRIDE] for one in (whole.q, whole.v, whole.a))
    empty, loaded = (
        model.rigid_body(load).inverse_dynamics(q, v, a) for load in (None, model.declared_payload)
    )
    light, heavy = (empty + (loaded - empty) / (1 + error) + model.rotor_inertia * a for error in (0.1, -0.1))
    largest = np.maximum(np.abs(light), np.abs(heavy)).max(axis=0)
    by_joint = np.abs(heavy - light).max(axis=0) / largest
    row = screen_factors(model, CYCLES, {"w5": RANGES["w5"]}, STEP).iloc[0]
    assert row["change"] == pytest.approx(by_joint.max(), rel=1e-9)
    assert row["joint"] == model.joints[by_joint.argmax()]


def test_a_number_moves_what_is_recorded_by_the_largest_share_of_any_signal(medium, monkeypatch):
    """One speed of four by one and one torque of ten by eight; another length is another recording."""
    q, qd, tau = np.ones((2, 2)), np.array([[1.0, 2.0], [-4.0, 2.0]]), np.array([[10.0, 8.0], [5.0, -10.0]])
    low = Recording(np.arange(2.0), q, qd, tau)
    slower, weaker = np.array([[1.0, 2.0], [-3.0, 2.0]]), np.array([[10.0, 8.0], [5.0, -2.0]])
    for high, change, joint in (
        (Recording(low.t, q, slower, weaker), 0.8, "axis_2"),
        (Recording(low.t, q, slower, tau), 0.25, "axis_1"),
        (Recording(low.t, q, qd, np.array([[10.0, 16.0], [5.0, -10.0]])), 0.5, "axis_2"),
        (Recording(low.t, q, qd, tau), 0.0, ""),
        (Recording(np.arange(3.0), *3 * [np.ones((3, 2))]), 1.0, "axis_1"),
    ):
        made = iter([low, high])
        monkeypatch.setattr(feasibility, "simulate_point", lambda *_, made=made, **__: next(made))
        ranges = {"w9": ("sensors.torque_noise %", -10.0, 10.0)}
        (row,) = screen_factors(medium, CYCLES, ranges, STEP).to_dict("records")
        assert (row["change"], row["joint"], row["moves"]) == (pytest.approx(change), joint, change > 0.0)


def test_wear_and_temperature_move_a_joint_s_torque_by_its_law(medium):
    """0.1 v a unit of wear at the second joint that wears, and 0.5 N m a kelvin about 50 degC at the last."""
    law = dict.fromkeys((f"eta{k}" for k in range(9)), 0.0) | {"eta3": 1.0, "eta8": 1.0, "eta9": 0.1}
    warm = {"coulomb_slope": 0.5, "viscous_slope": 0.0, "reference": 50.0}
    worn, last = medium.wear_joints[1], medium.joints[-1]
    effects = [(worn, "friction_wear_temperature", law), (last, "temperature_dependent_friction", warm)]
    model = medium.replace(
        effects=[{"joint": j, "effect": name, "parameters": values} for j, name, values in effects]
    )
    whole = CYCLES["point_to_point"].build(model, 0.05, STEP)
    q, v, a = (one[::STRIDE] for one in (whole.q, whole.v, whole.a))
    rigid = model.rigid_body(model.declared_payload).inverse_dynamics(q, v, a) + model.rotor_inertia * a
    table = screen_factors(model, CYCLES, RANGES, STEP).set_index("factor")
    assert not table.loc["f", "moves"]
    k, drag = model.joints.index(worn), 5.0 * v[:, model.joints.index(worn)]
    largest = max(np.abs(rigid[:, k]).max(), np.abs(rigid[:, k] + drag).max())
    assert table.loc["w1", "joint"] == worn
    assert table.loc["w1", "change"] == pytest.approx(np.abs(drag).max() / largest, rel=1e-9)
    level = 10.0 * np.sign(v[:, -1])
    largest = max(np.abs(rigid[:, -1] + side * level).max() for side in (1.0, -1.0))
    assert table.loc["w3", "joint"] == last
    assert table.loc["w3", "change"] == pytest.approx(20.0 / largest, rel=1e-9)


def test_the_factor_without_an_effect_is_found(medium):
    assert idle(medium.replace(payload=None)) == {"w5"}
    assert idle(medium.replace(effects=plain_friction(medium, ["axis_2"]))) == {"w1"}
    assert idle(medium.replace(effects=plain_friction(medium, medium.joints))) == {"f", "w1", "w3"}


def test_a_motion_without_pauses_is_not_moved_by_their_length(medium):
    sweep = Cycle("sweep", "", lambda model, dwell, step: CYCLES["point_to_point"].build(model, 0.05, step))
    cycles = {"sweep": sweep}
    table = screen_factors(medium, cycles, RANGES, STEP).set_index("factor")
    assert not table.loc["w4", "moves"]
    both = screen_factors(medium, cycles | CYCLES, RANGES, STEP).set_index("factor")
    assert both.loc["w4", "moves"] and both.loc["w4", "cycle"] == "point_to_point"


def test_screening_says_what_the_simulation_shows(medium):
    """A factor that is idle leaves the recorded torque as it is, to the last bit; one that moves does not."""
    model = medium.replace(effects=plain_friction(medium, ["axis_2"]))
    reference = CYCLES["point_to_point"].build(model, 0.05, STEP)
    low = simulate_point(model, reference, Conditions(wear=(0.0, 0.0)))
    second = simulate_point(model, reference, Conditions(wear=(0.0, 50.0)))
    first = simulate_point(model, reference, Conditions(wear=(50.0, 0.0)))
    assert low.tau.tobytes() == second.tau.tobytes()
    assert low.tau.tobytes() != first.tau.tobytes()


def test_refusal_names_robot_factor_and_remedy(medium, refuses):
    table = screen_factors(medium.replace(payload=None), CYCLES, RANGES, STEP)
    refuses(check_screening, table, "arm", ["f"])
    dropped = check_screening(table, "arm", ["f"], "drop")
    assert list(dropped.loc[dropped["dropped"], "factor"]) == ["w5"]


def test_the_fault_itself_is_never_dropped(medium):
    table = screen_factors(medium.replace(effects=plain_friction(medium, ["axis_2"])), CYCLES, RANGES, STEP)
    with pytest.raises(InputError, match=r"factors.w1: wear moves no recorded torque of robot 'arm'") as told:
        check_screening(table, "arm", ["f", "w1"], "drop")
    assert "screening: drop" not in str(told.value)
    assert check_screening(table, "arm", ["f"], "drop")["dropped"].sum() == 1


def test_answers_about_a_dropped_factor_are_left_out_of_that_robot_alone():
    screening = pd.DataFrame({"robot": ["a", "b"], "factor": ["w3", "w3"], "dropped": [True, False]})
    terms = ["1", "f", "w3", "f:w3", "w3^2", "w31"]
    table = pd.DataFrame({"robot": ["a"] * 6 + ["b"] * 6, "term": terms * 2})
    kept = drop_idle(table, screening, "term")
    assert list(kept.loc[kept["robot"] == "a", "term"]) == ["1", "f", "w31"]
    assert len(kept[kept["robot"] == "b"]) == 6
