import copy

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
    tell_planted,
    tell_rivals,
    tell_why,
)

ENTRY = {
    "joint": "axis_2", "effect": "gravity_counterbalance", "equivalent": ["joint_spring"],
    "depends_on": ["q_axis_2"], "parameters": {}, "error_reduction": 0.93,
    "error_reduction_ci95": [0.9, 0.95], "status": "confirmed",
}  # fmt: skip
JOINT = {"unit": "N m", "rms_before": 12.0, "rms_after": 11.8, "noise_floor": 9.0, "state": "explained"}
VERDICT = {"verdict": [ENTRY], "joints": {"axis_1": dict(JOINT), "axis_2": dict(JOINT)}}


def planted(effect="gravity_counterbalance", joint="axis_2"):
    return {"planted": [{"effect": effect, "accepted": [effect], "joint": joint}]}


@pytest.mark.parametrize("effect", ["gravity_counterbalance", "joint_spring"])
def test_what_was_planted_is_found_also_by_an_equivalent_name(effect):
    said = tell_planted(VERDICT, planted(effect))
    assert said == f"Planted was {effect.replace('_', ' ')} at axis_2, which the loop found."


@pytest.mark.parametrize("truth", [planted("viscous"), planted(joint="axis_1")])
def test_a_wrong_name_or_joint_is_told(truth):
    said = tell_planted(VERDICT, truth)
    assert "which the loop did not find." in said
    assert said.endswith("It named what was not planted: gravity counterbalance at axis_2.")


def test_nothing_planted_is_a_null():
    none = {**VERDICT, "verdict": []}
    assert tell_planted(none, planted()).endswith("did not find.")
    assert tell_planted(none, {"planted": []}) == "Nothing was planted: so it should be."
    assert tell_planted(VERDICT, {"planted": []}) == "Nothing was planted: a false alarm."


def test_effects_and_parameters_are_called_what_people_call_them():
    """Codes that say too little have a name; own ones are told as text. A share near all has a digit more."""
    assert effect_name("stribeck") == "Stribeck friction" and effect_name("hose_drag") == "hose drag"
    assert parameter_name("sine1") == "amplitude of the sine of position"
    known = {part.name for one in list_effects() for part in (*one.coefficients, *one.shape)}
    assert set(PARAMETERS) <= known
    nearly = ENTRY | {"error_reduction": 0.9964, "error_reduction_ci95": [0.995, 0.998]}
    assert say_share(nearly) == "it removes 99.6 % (95 %: 99.5 to 99.8) of the residual variance"


def test_shares_of_the_residual():
    assert say_share(ENTRY) == "it removes 93 % (95 %: 90 to 95) of the residual variance"
    worse = ENTRY | {"error_reduction": -0.2, "error_reduction_ci95": [-0.3, -0.1]}
    assert say_share(worse) == "it adds 20 % (95 %: 10 to 30) to the residual variance"
    assert "unknown share" in say_share(ENTRY | {"error_reduction": None, "error_reduction_ci95": [None] * 2})


def test_an_empty_verdict_says_what_it_means():
    verdict = copy.deepcopy(VERDICT) | {"verdict": []}
    assert list_alarms(verdict) == []
    assert conclude_loop(verdict)[1].startswith("The declared model suffices")
    verdict["joints"]["axis_2"] |= {"state": "not_judged"}
    assert conclude_loop(verdict) == (
        "unsure", "Nothing that the declared model lacks is seen, and axis_2 is not judged.",
    )  # fmt: skip
    verdict["joints"]["axis_1"] |= {"state": "unexplained"}
    assert "axis_1 keeps something unexplained" in conclude_loop(verdict)[1]


def test_what_is_left_at_a_joint():
    left = JOINT | {
        "state": "unexplained",
        "unexplained_rms": 30.0,
        "depends_on": ["q_a", "t"],
        "reason": "seen",
    }
    assert tell_left(left) == "30 N m RMS of it depends on position of a and time"
    assert size_left(JOINT | {"left_percent": 3.0}) == "3 % of the torque" and size_left(JOINT) == ""


def test_noise_that_is_much_of_the_torque_is_told_on_top():
    verdict = copy.deepcopy(VERDICT) | {"verdict": []}
    verdict["joints"]["axis_2"]["left_percent"] = 47.0
    assert conclude_loop(verdict) == (
        "unsure",
        "Nothing that the declared model lacks is seen, but 47 % of the torque is left at axis_2, as noise.",
    )
    named = verdict | {"verdict": [ENTRY | {"equivalent": []}]}
    kind, told = conclude_loop(named)
    assert kind == "unsure" and told.endswith(". 47 % of the torque is left at axis_2, as noise.")


def test_each_name_has_the_place_that_its_effect_has():
    mixed = ENTRY | {"effect": "inertial_error"}
    told = "inertial error of the robot or joint spring at axis_2"
    assert name_with_rivals(mixed) == told and told in conclude_loop(VERDICT | {"verdict": [mixed]})[1]
    assert name_with_rivals(ENTRY) == "gravity counterbalance or joint spring at axis_2"
    assert name_with_rivals(mixed | {"equivalent": ["payload_error"]}).endswith("payload error of the robot")


def test_growth_of_less_than_half_a_percent_is_no_matter():
    sure = copy.deepcopy(VERDICT) | {"verdict": [ENTRY | {"equivalent": []}]}
    sure["joints"]["axis_1"] |= {"rms_after": 12.05, "error": "larger"}
    kind, told = conclude_loop(sure)
    assert kind == "good" and "grows" not in told
    sure["joints"]["axis_1"] |= {"rms_after": 12.5}
    assert "but grows by 4 % at axis_1" in conclude_loop(sure)[1]


def test_structure_that_the_test_runs_alone_show_has_no_size_of_its_own():
    left = JOINT | {"state": "unexplained", "unexplained_rms": 0.01, "depends_on": []}
    reason = "the test runs' error is 4.0 times the training runs'"
    assert tell_left(left | {"reason": reason}) == f"T{reason[1:]}"


def test_a_correction_without_a_name_is_no_model_that_suffices():
    unknown = ENTRY | {"effect": "unknown", "equivalent": [], "in_model": True}
    kind, told = conclude_loop(copy.deepcopy(VERDICT) | {"verdict": [unknown]})
    assert kind == "unsure" and told.startswith("The declared model lacks a torque without a name at axis_2.")
    left_out = copy.deepcopy(VERDICT) | {"verdict": [unknown | {"in_model": False}]}
    assert conclude_loop(left_out)[1].startswith("The declared model suffices")


def test_a_headline_has_three_names_and_a_count_and_each_joint_once():
    joints = {f"axis_{k}": dict(JOINT) for k in range(1, 6)}
    names = ["backlash", "backlash", "stribeck", "joint_spring", "torque_ripple", "quadratic_viscous"]
    where = ["axis_1", "axis_1", "axis_2", "axis_3", "axis_4", "axis_5"]
    entries = [ENTRY | {"effect": n, "joint": j, "equivalent": []} for n, j in zip(names, where, strict=True)]
    text = conclude_loop({"verdict": entries, "joints": joints})[1]
    assert "backlash at axis_1; " in text and "; and 2 more. " in text
    assert "ripple" not in text


def test_joints_with_one_name_are_told_together_and_their_rivals_apart():
    joints = {f"axis_{k}": dict(JOINT) for k in range(1, 5)}
    rivals = [[], ["quadratic_viscous"], ["quadratic_viscous"], ["warm_up_drift"]]
    entries = [
        ENTRY | {"effect": "stribeck", "joint": joint, "equivalent": others}
        for joint, others in zip(joints, rivals, strict=True)
    ]
    verdict = {"verdict": entries, "joints": joints}
    kind, text = conclude_loop(verdict)
    assert kind == "unsure"
    assert text.startswith(
        "The declared model lacks Stribeck friction at all 4 joints (at 3 of them other names fit as well). "
    )
    assert tell_rivals(verdict) == (
        "These runs leave open whether it is Stribeck friction or quadratic viscous friction at axis_2 and "
        "axis_3; Stribeck friction or warm up drift at axis_4."
    )


def test_a_load_that_refitted_masses_stand_in_for_is_said_first():
    note = (
        f"{LOAD[0]}+36 kg (+35 to +37) in addition to the stated one: it removes 96 % of the error. State it."
    )
    loaded = copy.deepcopy(VERDICT) | {"notes": ["another: one.", note]}
    kind, text = conclude_loop(loaded)
    begun = f"{LOAD[0]}+36 kg (+35 to +37) in addition to the stated one. The declared model "
    assert kind == "unsure" and text.startswith(f"{begun}also lacks gravity counterbalance")
    nothing = loaded | {"verdict": []}
    kind, text = conclude_loop(nothing)
    assert kind == "unsure" and text.endswith("Nothing else that the declared model lacks is seen.")
    nothing["joints"]["axis_2"] |= {"state": "unexplained"}
    assert conclude_loop(nothing)[1].endswith("lacks is seen, and axis_2 keeps something unexplained.")


def test_loads_by_run_are_said_first():
    note = f"{LOAD[1]}, b.csv with 1.49 kg (1.47 to 1.5) more than the others: loads by run explain 99 %."
    kind, text = conclude_loop(VERDICT | {"verdict": [], "notes": [note]})
    assert kind == "unsure" and text.startswith(f"{note.partition(':')[0]}. Nothing else that the declared")


@pytest.mark.parametrize("statuses", [("confirmed", "not_confirmed"), ("not_confirmed", "confirmed")])
def test_one_delay_of_the_recorder_is_one_name(statuses):
    """It is confirmed where a joint's motion shows it."""
    delays = [
        ENTRY | {"joint": f"axis_{k + 1}", "effect": "time_delay", "equivalent": [], "status": status}
        for k, status in enumerate(statuses)
    ]
    verdict = copy.deepcopy(VERDICT) | {"verdict": delays}
    verdict["time_delay"] = {"effect": "time_delay", "seconds": 0.00994, "joints": ["axis_1", "axis_2"]}
    assert "lacks one delay of the recorder (9.94 ms) at axis_1 and axis_2. " in conclude_loop(verdict)[1]
    for one in delays:
        one["status"] = "not_confirmed"
    assert "axis_1 and axis_2 (not confirmed)" in conclude_loop(verdict)[1]
    verdict["time_delay"] = None
    assert "lacks time delay at axis_1 and axis_2 (not confirmed)" in conclude_loop(verdict)[1]


def test_runs_that_contradict_each_other_are_the_reason():
    reason = "training runs contradict each other: b.csv and the others"
    assert tell_why({"depends_on": ["t"], "reason": reason}) == reason
    assert tell_why({"depends_on": ["t"], "reason": "its mean differs"}) == "it depends on time"
