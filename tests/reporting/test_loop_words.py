"""The outcome of a loop in words, on verdicts made by hand; what is said stands in the ``.txt`` file."""

import pytest

from wearscope.effects.vocabulary import list_effects
from wearscope.reporting.labels import PARAMETERS, effect_name, parameter_name
from wearscope.reporting.loop_words import (
    LOAD,
    conclude_loop,
    list_alarms,
    name_with_rivals,
    say_share,
    size_left,
    tell_left,
    tell_measurement,
    tell_planted,
    tell_rivals,
    tell_why,
)

ENTRY = {
    "joint": "axis_2", "effect": "gravity_counterbalance", "equivalent": ["joint_spring"],
    "depends_on": ["q_axis_2"], "parameters": {}, "error_reduction": 0.93,
    "error_reduction_ci95": [0.9, 0.95], "status": "confirmed",
}  # fmt: skip
ALONE = ENTRY | {"equivalent": []}
JOINT = {"unit": "N m", "rms_before": 12.0, "rms_after": 11.8, "noise_floor": 9.0, "state": "explained"}
VERDICT = {"verdict": [ENTRY], "joints": {"axis_1": dict(JOINT), "axis_2": dict(JOINT)}}


def changed(*verdict, axis_1=(), axis_2=(), **fields):
    joints = {"axis_1": JOINT | dict(axis_1), "axis_2": JOINT | dict(axis_2)}
    return {"verdict": list(verdict), "joints": joints} | fields


def at_joints(*entries):
    """A verdict of effects at joints, each with its rivals."""
    joints = {joint: dict(JOINT) for _, joint, _ in entries}
    named = [
        ENTRY | {"effect": name, "joint": joint, "equivalent": list(rivals)}
        for name, joint, rivals in entries
    ]
    return {"verdict": named, "joints": joints}


def delayed(first, second, time_delay):
    """One delay at both joints, confirmed where a joint's motion shows it."""
    entries = [
        ALONE | {"joint": f"axis_{k}", "effect": "time_delay", "status": status}
        for k, status in enumerate((first, second), 1)
    ]
    return changed(*entries, time_delay=time_delay)


DELAY = {"effect": "time_delay", "seconds": 0.00994, "joints": ["axis_1", "axis_2"]}
UNKNOWN = ALONE | {"effect": "unknown"}
LOADED = f"{LOAD[0]}act as a payload of +36 kg (+35 to +37) in addition to the stated one: it removes 96 %."
LOADS = f"{LOAD[1]}, b.csv with 1.49 kg (1.47 to 1.5) more than the others: loads by run explain 99 %."
UNEXPLAINED = {"state": "unexplained"}
CASES = {
    "a name with a rival": VERDICT,
    "no name": changed(),
    "no name, a joint is not judged": changed(axis_2={"state": "not_judged"}),
    "no name, structure and a joint that is not judged": changed(
        axis_1=UNEXPLAINED, axis_2={"state": "not_judged"}
    ),
    "no name, noise is much of the torque": changed(axis_2={"left_percent": 47.0}),
    "a name, noise is much of the torque": changed(ALONE, axis_2={"left_percent": 47.0}),
    "a rival at another place": changed(ENTRY | {"effect": "inertial_error"}),
    "the robot's effect is the rival": changed(ENTRY | {"equivalent": ["payload_error"]}),
    "an error grows by less than half a percent": changed(
        ALONE, axis_1={"rms_after": 12.05, "error": "larger"}
    ),
    "an error grows": changed(ALONE, axis_1={"rms_after": 12.5, "error": "larger"}),
    "a torque without a name": changed(UNKNOWN | {"in_model": True}),
    "a torque without a name is left out": changed(UNKNOWN | {"in_model": False}),
    "three names and a count, each joint once": at_joints(
        ("backlash", "axis_1", ()), ("backlash", "axis_1", ()), ("stribeck", "axis_2", ()),
        ("joint_spring", "axis_3", ()), ("torque_ripple", "axis_4", ()), ("quadratic_viscous", "axis_5", ()),
    ),
    "joints with one name and other rivals": at_joints(
        ("stribeck", "axis_1", ()), ("stribeck", "axis_2", ["quadratic_viscous"]),
        ("stribeck", "axis_3", ["quadratic_viscous"]), ("stribeck", "axis_4", ["warm_up_drift"]),
    ),
    "refitted masses act as a payload": changed(ENTRY, notes=["another: one.", LOADED]),
    "refitted masses act as a payload, no name": changed(notes=[LOADED]),
    "refitted masses act as a payload, structure is left": changed(axis_2=UNEXPLAINED, notes=[LOADED]),
    "the load differs between runs": changed(notes=[LOADS]),
    "one delay of the recorder": delayed("confirmed", "not_confirmed", DELAY),
    "one delay, confirmed at the second joint": delayed("not_confirmed", "confirmed", DELAY),
    "one delay, not confirmed": delayed("not_confirmed", "not_confirmed", DELAY),
    "a delay at each joint": delayed("not_confirmed", "not_confirmed", None),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_verdict_is_concluded_no_surer_than_its_parts(case, says):
    verdict = CASES[case]
    says(case, *conclude_loop(verdict), tell_rivals(verdict), *map(name_with_rivals, verdict["verdict"]))
    assert list_alarms(verdict) == []


def planted(effect="gravity_counterbalance", joint="axis_2"):
    return {"planted": [{"effect": effect, "accepted": [effect], "joint": joint}]}


def test_what_was_planted_is_found_also_by_an_equivalent_name(says):
    """Of a name and of none: planted is that name, its rival, another effect, one elsewhere, and nothing."""
    others = planted("joint_spring"), planted("viscous"), planted(joint="axis_1")
    for case, verdict in (("what was planted, a name", VERDICT), ("what was planted, no name", changed())):
        says(case, *(tell_planted(verdict, truth) for truth in (planted(), *others, {"planted": []})))


def test_effects_and_parameters_are_called_what_people_call_them():
    """Codes that say too little have a name; own ones are told as text."""
    assert effect_name("stribeck") == "Stribeck friction" and effect_name("hose_drag") == "hose drag"
    assert parameter_name("sine1") == "amplitude of the sine of position"
    known = {part.name for one in list_effects() for part in (*one.coefficients, *one.shape)}
    assert set(PARAMETERS) <= known


def test_shares_of_the_residual(says):
    shares = (0.93, 0.9, 0.95), (0.9964, 0.995, 0.998), (-0.2, -0.3, -0.1), (None, None, None)
    entries = (ENTRY | {"error_reduction": one, "error_reduction_ci95": ends} for one, *ends in shares)
    says("shares of the residual", *map(say_share, entries))


def test_what_is_left_at_a_joint():
    left = JOINT | UNEXPLAINED | {"unexplained_rms": 30.0, "depends_on": ["q_a", "t"], "reason": "seen"}
    assert tell_left(left) == "30 N m RMS of the training runs' residual depends on position of a and time"
    reason = "the test runs' error is 4.0 times the training runs'"
    assert tell_left(left | {"depends_on": [], "reason": reason}) == f"T{reason[1:]}"
    assert size_left(JOINT | {"left_percent": 3.0}) == "3 % of the torque" and size_left(JOINT) == ""
    reason = "training runs contradict each other: b.csv and the others"
    assert tell_why({"depends_on": ["t"], "reason": reason}) == reason
    assert tell_why({"depends_on": ["t"], "reason": "its mean differs"}) == "it depends on time"


@pytest.mark.parametrize(
    ("share", "ends", "text"),
    [(-2.803, (-5.104, -1.281), "adds 280 % (95 %: 128 to 510)"), (0.997, (0.99, 0.999), "removes 99.7 %")],
)
def test_a_share_has_a_decimal_only_near_its_ends(share, ends, text):
    assert text in say_share({"error_reduction": share, "error_reduction_ci95": ends})


def test_a_tiny_probability_is_told_in_words():
    plan = {"names": ["stribeck", "coulomb"], "runs": 6, "power": 8.1e-57, "plans_compared": 36}
    assert "with probability less than 0.01, after 6 runs" in tell_measurement(plan)
