"""The scorer on hand-made verdicts and the summary's intervals."""

import json
import time

import pandas as pd
import pytest
from scipy.stats import beta

from benchmarks.board.regimes import list_cases
from benchmarks.board.truth import CONTAINED
from benchmarks.runner import failed_result, run_cases, write_results
from benchmarks.scoring import score_case
from benchmarks.summary import SCORES, tell_share
from wearscope.effects.base import load_effect


def plant(effect, joint="j1", **changes):
    entry = {
        "effect": effect, "accepted": [effect], "also_accepted": [], "contains": [], "outside": False,
        "standard": False, "joint": joint, "joints": [joint], "size": 4.0, "measured_size": 4.0,
        "findable_size": 1.0, "times_findable": 4.0, "separable": True, "rivals": {},
        "parameters": {"level": {"value": 2.0, "unit": "N m"}},
    }  # fmt: skip
    return entry | changes


def said(effect, joint="j1", **changes):
    return {"effect": effect, "joint": joint, "equivalent": [], "depends_on": [], "parameters": {}} | changes


def score(planted, *entries, joints=None):
    return score_case({"planted": planted}, {"verdict": list(entries), "joints": joints or {}})


def test_all_and_only_the_planted_effects_is_exact():
    planted = [plant("coulomb"), plant("viscous", "j2")]
    case, rows = score(planted, said("viscous", "j2"), said("coulomb"))
    assert case["exact"] and case["outcome"] == "exact" and case["named"] == case["required"] == 2
    assert [row["grade"] for row in rows] == ["right", "right"]


def test_one_missed_or_one_extra_or_the_wrong_joint_is_not_exact():
    assert score([plant("coulomb"), plant("viscous")], said("coulomb"))[0]["outcome"] == "missed"
    case, rows = score([plant("coulomb")], said("coulomb"), said("backlash"))
    assert not case["exact"] and case["extra"] == 1 and rows[-1]["kind"] == "extra"
    case, _ = score([plant("coulomb")], said("coulomb", "j2"))
    assert case["outcome"] == "both" and case["extra"] == 1 and case["missed"] == 1
    case, _ = score([plant("coulomb")], said("coulomb"), said("unknown"))
    assert not case["exact"] and case["extra"] == 0 and case["unknowns"] == 1


def test_a_part_of_a_planted_effect_is_neither_its_name_nor_an_extra_one():
    hysteresis = plant("presliding_hysteresis", contains=["coulomb"])
    assert score([hysteresis], said("presliding_hysteresis"), said("coulomb"))[0]["exact"]
    case, rows = score([hysteresis], said("coulomb"))
    assert case["outcome"] == "missed" and case["extra"] == 0
    assert rows[0]["grade"] == "missed"
    assert score([hysteresis], said("presliding_hysteresis"), said("coulomb", "j2"))[0]["extra"] == 1
    for effect, parts in CONTAINED.items():
        assert set(parts) <= set(load_effect(effect).parents)


def test_what_cannot_be_found_or_told_apart_may_be_left_out_or_named():
    weak = plant("stribeck", times_findable=1.5)
    twin = plant("torque_offset", separable=False, rivals={"coulomb_asymmetry": 0.0})
    assert score([weak, twin])[0]["exact"]
    assert score([weak, twin], said("stribeck"), said("coulomb_asymmetry"))[0]["exact"]
    # the excuse holds at its own joint and for its own rivals alone
    assert not score([twin], said("coulomb_asymmetry", "j2"))[0]["exact"]
    assert not score([twin], said("viscous_asymmetry"))[0]["exact"]
    assert not score([plant("torque_offset")], said("coulomb_asymmetry"))[0]["exact"]


def test_a_confidence_set_with_the_truth_counts_as_found():
    case, rows = score([plant("coulomb")], said("stribeck", equivalent=["coulomb"]))
    assert case["exact"] and rows[0]["grade"] == "equivalent"


def test_nulls_are_false_where_anything_is_said():
    assert score([])[0]["false_in_null"] is False
    assert score([], said("unknown"))[0]["false_in_null"] is True
    assert score([plant("coulomb")])[0]["false_in_null"] is None


def test_outside_effects_want_unknown_or_a_joint_called_unexplained():
    outer = plant("square_wave", outside=True, accepted=["square_wave"])
    assert score([outer], said("unknown"))[0]["outside_answered"]
    assert score([outer], joints={"j1": {"state": "unexplained"}})[0]["outside_answered"]
    case, _ = score([outer])
    assert case["outside_answered"] is False and not case["exact"]
    assert score([outer], said("warm_up_drift"))[0]["extra"] == 1
    # a joint without a state is unknown, not a failure of the score
    assert score([outer], said("unknown"), joints={"j1": {"rms_before": 1.0, "rms_after": 1.0}})[0]["exact"]


def test_a_joint_is_falsely_unexplained_only_where_all_is_named():
    planted = [plant("coulomb"), plant("viscous", "j2"), plant("square_wave", "j3", outside=True)]
    joints = {f"j{k}": {"state": "unexplained"} for k in (1, 2, 3, 4)}
    case, _ = score(planted, said("coulomb"), joints=joints)
    # j2 holds what is not named, j3 what has no name
    assert (case["false_unexplained"], case["joints"]) == (2, 4)
    hum = score_case({"planted": planted, "noise": "hum"}, {"verdict": [], "joints": joints})[0]
    assert hum["false_unexplained"] is None


def test_harm_and_refutation_are_counted():
    joints = {"j1": {"rms_before": 1.0, "rms_after": 1.04}, "j2": {"rms_before": 1.0, "rms_after": 0.5}}
    case, _ = score([plant("coulomb")], said("coulomb", status="refuted"), joints=joints)
    assert case["worse"] and case["worst_ratio"] == pytest.approx(1.04)
    assert case["refuted"] == case["statuses"] == 1
    assert score([plant("coulomb")], said("coulomb"))[0]["statuses"] == 0


def test_a_refuted_name_counts_once_whatever_it_accounts_for():
    gain = plant("torque_constant_error", also_accepted=["coulomb"], separable=False, rivals={"coulomb": 0.1})
    entries = said("coulomb", status="refuted"), said("viscous", status="confirmed")
    case, rows = score([plant("coulomb"), gain], *entries)
    assert [row["status"] for row in rows] == ["refuted", "refuted", "confirmed"]
    refuted = SCORES["refuted"][1](pd.DataFrame([case]), pd.DataFrame(rows))
    assert tell_share(refuted)["share"] == 0.5


def test_a_set_holds_the_truth_by_name_whatever_else_the_name_accounts_for():
    """A buried effect that a right name may hide is no second set; a name that only hides one is wrong."""
    buried = plant("rotor_inertia", separable=False, rivals={"coulomb": 0.0})
    spring = plant("joint_spring", "j2", separable=False, rivals={"torque_offset": 0.0})
    named = said("coulomb"), said("torque_offset", "j2"), said("stribeck", equivalent=["viscous"])
    case, rows = score([plant("coulomb"), buried, spring, plant("viscous")], *named, said("backlash"))
    assert [row["grade"] for row in rows] == ["right", "excused", "excused", "equivalent", "extra"]
    holds = SCORES["set_holds_truth"][1](pd.DataFrame([case]), pd.DataFrame(rows).assign(dataset="d"))
    assert sorted(holds.tolist()) == [False, False, True, True]


def test_parameters_are_compared_with_their_interval():
    stated = {"level": {"value": 2.2, "ci95": [1.9, 2.4], "unit": "N m"}}
    _, rows = score([plant("coulomb")], said("coulomb", parameters=stated))
    assert rows[0]["parameter_error"] == pytest.approx(0.1) and rows[0]["covered"] == 1.0
    stated["level"]["ci95"] = [2.1, 2.4]
    assert score([plant("coulomb")], said("coulomb", parameters=stated))[1][0]["covered"] == 0.0
    # Of a plant with another form, the range between its value and that of the usual form.
    other = plant("coulomb")
    other["parameters"]["level"]["nearest"] = 2.2
    assert score([other], said("coulomb", parameters=stated))[1][0]["covered"] == 1.0
    stated["level"]["ci95"] = [1.5, 1.9]
    assert score([other], said("coulomb", parameters=stated))[1][0]["covered"] == 0.0


def test_shares_have_the_clopper_pearson_interval():
    share = tell_share(pd.Series([True] * 3 + [False] * 7 + [None], dtype=object))
    assert (share["hits"], share["cases"]) == (3, 10)
    assert share["ci95"] == pytest.approx([beta.ppf(0.025, 3, 8), beta.ppf(0.975, 4, 7)])
    assert tell_share(pd.Series([False] * 5))["ci95"][0] == 0.0
    assert tell_share(pd.Series(dtype=object))["share"] is None


def test_a_failed_case_finds_nothing_and_says_why(tmp_path):
    case = list_cases("development", 4, 1)[1]
    truth = {"planted": [plant("coulomb")], "declared": ["rigid_body"]}
    result = failed_result(case, truth, "time limit of 300 s", 300.0)
    assert result["case"]["outcome"] == "failed" and not result["case"]["exact"]
    assert not result["entries"][0]["found"]
    summary = write_results([result], tmp_path)
    assert summary["errors"] == {"time limit of 300 s": 1}
    assert "time limit of 300 s" in (tmp_path / "board.md").read_text()


def answer_truthfully(dataset, out_dir):
    """Closer that says nothing at all, as a tracer that finds nothing would."""
    (out_dir / "verdict.json").write_text(json.dumps({"verdict": [], "joints": {}}))


def never_answer(dataset, out_dir):
    """Closer that never comes back."""
    time.sleep(600)


@pytest.mark.parametrize("closer", [answer_truthfully, never_answer])
def test_a_board_runs_from_case_to_tables(closer, tmp_path):
    lines = []
    limit = 300.0 if closer is answer_truthfully else 0.5
    smallest = min(
        list_cases("development", 6, 1),
        key=lambda case: case.recipe.duration * case.recipe.rate * len(case.machine.joints),
    )
    summary = run_cases(
        [smallest], tmp_path / "out", limit=limit, closer=closer, tell=lines.append, keep=tmp_path / "kept"
    )
    assert len(lines) == summary["cases"] == 1
    table = pd.read_parquet(tmp_path / "out" / "cases.parquet")
    failed = closer is never_answer
    assert (table["outcome"][0] == "failed") == failed
    assert summary["total"]["failed"]["hits"] == int(failed)
    (folder,) = (tmp_path / "kept").iterdir()
    assert next(folder.glob("d*/dataset.yaml")).is_file()
