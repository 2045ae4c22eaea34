import copy

import numpy as np
import pytest

from wearscope.reporting.loop import draw_loop, joint_table, verdict_sentences

VERDICT = {
    "dataset": "twin",
    "verdict": [
        {
            "joint": "axis_2", "effect": "gravity_counterbalance", "equivalent": ["joint_spring"],
            "depends_on": ["q_axis_2"], "parameters": {}, "error_reduction": 0.93,
            "error_reduction_ci95": [0.9, 0.95], "status": "confirmed",
        }
    ],
    "joints": {
        "axis_1": {
            "unit": "N m", "rms_before": 12.0, "rms_after": 11.8, "noise_floor": 9.0, "state": "explained",
        },
        "axis_2": {
            "unit": "N m", "rms_before": 140.0, "rms_after": 35.0, "noise_floor": None, "state": "corrected",
        },
    },
    "stopped": [],
}  # fmt: skip


def planted(effect="gravity_counterbalance", joint="axis_2"):
    return {"planted": [{"effect": effect, "accepted": [effect], "joint": joint}]}


def test_the_effect_is_named_with_what_it_removes():
    said = verdict_sentences(VERDICT, planted())
    assert said[0].startswith(
        "gravity_counterbalance on axis_2, depending on q_axis_2. The test runs confirm it:"
    )
    assert "removes 93 % (95 %: 90 to 95) of the residual variance" in said[0]
    assert "It cannot be told from joint_spring on these runs." in said[0]
    assert said[1] == "Planted was gravity_counterbalance on axis_2, which it found."


@pytest.mark.parametrize("truth", [planted("viscous"), planted(joint="axis_1")])
def test_a_wrong_name_or_joint_is_told(truth):
    said = verdict_sentences(VERDICT, truth)[1]
    assert "which it did not find." in said
    assert said.endswith("It named what was not planted: gravity_counterbalance on axis_2.")


def test_an_equivalent_effect_counts_as_found():
    assert verdict_sentences(VERDICT, planted("joint_spring"))[1].endswith("which it found.")


def test_none_and_unknown_are_answers():
    none = {**VERDICT, "verdict": []}
    assert verdict_sentences(none) == ["None: the declared model suffices, no effect was added."]
    assert verdict_sentences(none, planted())[1].endswith("which it did not find.")
    assert verdict_sentences(none, {"planted": []})[1] == "Nothing was planted: so it should be."
    assert verdict_sentences(VERDICT, {"planted": []})[1] == "Nothing was planted: a false alarm."
    unknown = copy.deepcopy(VERDICT)
    unknown["verdict"][0] |= {"effect": "unknown", "equivalent": []}
    assert verdict_sentences(unknown)[0].startswith("Unknown on axis_2: structure that no named effect")


def test_more_than_was_planted_is_told():
    twice = copy.deepcopy(VERDICT)
    twice["verdict"].append({**twice["verdict"][0], "effect": "viscous", "joint": "axis_1"})
    assert verdict_sentences(twice, planted())[-1].endswith(
        "It named what was not planted: viscous on axis_1."
    )


def test_errors_by_joint_and_a_missing_floor():
    table = joint_table(VERDICT)
    assert table["change [%]"].to_list() == pytest.approx([-100 * 0.2 / 12, -75.0])
    assert np.isnan(table["noise floor"].iloc[1])
    assert "as declared" not in table and "simulated after" not in table
    figure = draw_loop(VERDICT)
    points = {line.get_label(): line.get_xdata() for line in figure.axes[0].lines if line.get_marker() == "o"}
    assert list(points["before"]) == [12.0, 140.0] and list(points["after"]) == [11.8, 35.0]
    ticks = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert ticks == ["axis_1", "axis_2 (no noise floor)"]
    assert figure.axes[0].get_xscale() == "linear"


def test_intervals_forward_simulation_and_parameters_are_shown():
    more = copy.deepcopy(VERDICT)
    more["joints"]["axis_1"] |= {"rms_as_declared": 900.0, "rms_before_ci95": [0.4, 20.0]}
    more["joints"]["axis_1"]["rms_after"] = 0.5
    more["forward"] = {"axis_1": {"after": {"torque_rms": 12.5, "outcome": "ok"}}}
    more["verdict"][0]["parameters"] = {"k": {"value": 7683.4, "ci95": [5913.0, None], "unit": "N m/rad"}}
    table = joint_table(more).set_index("joint")
    assert table.loc["axis_1", ["as declared", "simulated after"]].to_list() == [900.0, 12.5]
    assert np.isnan(table.loc["axis_2", "simulated after"])
    ax = draw_loop(more).axes[0]
    assert ax.get_xscale() == "log"
    assert [0.4, 20.0] in [list(line.get_xdata()) for line in ax.lines]
    assert "(k 7,683 N m/rad, 95 % 5,913 to n/a)" in verdict_sentences(more)[0]


def test_refuted_effects_are_told_first():
    verdict = copy.deepcopy(VERDICT)
    refuted = {**verdict["verdict"][0], "effect": "backlash", "status": "refuted", "error_reduction": -0.2}
    verdict["verdict"].append(refuted | {"error_reduction_ci95": [-0.3, -0.1]})
    said = verdict_sentences(verdict)
    assert "The test runs refute it: it adds 20 % (95 %: 10 to 30) to the residual variance" in said[0]
    assert said[0].startswith("backlash") and said[1].startswith("gravity_counterbalance")


def test_what_is_left_and_why_the_search_stopped_are_told():
    verdict = copy.deepcopy(VERDICT) | {"verdict": [], "stopped": ["axis_1: the most terms are named"]}
    left = {"state": "unexplained", "unexplained_rms": 30.0, "depends_on": ["q_axis_2", "t"]}
    verdict["joints"]["axis_2"] |= left
    assert verdict_sentences(verdict) == [
        "No effect was named, and the declared model does not suffice.",
        "Unexplained on axis_2: 30 N m RMS, depending on q_axis_2 and t.",
        "axis_1: the most terms are named.",
    ]
