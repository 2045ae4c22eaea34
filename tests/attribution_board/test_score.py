"""Scoring of hand-made verdicts, and the board's tables."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, sosfiltfilt

from wearscope.attribution_board.score import read_verdict, score_case, true_floor
from wearscope.attribution_board.summary import (
    bound_share,
    find_smallest_sizes,
    summarise,
    tabulate_confusion,
    upper_bound,
    write_markdown,
)
from wearscope.errors import InputError


def plant(effect="stribeck", joint="j2", size=4.0, outside=False, **more):
    entry = {
        "effect": effect, "accepted": [effect], "also_accepted": [], "outside": outside, "joint": joint,
        "joints": [joint], "size": size, "unabsorbed_size": size / 2, "separable": True, "rivals": {},
        "parameters": {},
    }  # fmt: skip
    return entry | more


def make_truth(*planted, dataset="d1", noise="plain"):
    return {
        "dataset": dataset, "robot": "arm3", "seed": 0, "joints": ["j1", "j2"], "noise": noise,
        "noise_rms": {"j1": 1.0, "j2": 2.0}, "planted": list(planted),
        "recipe": {"rate": 250.0, "plans": [{"use": "train"}, {"use": "test"}]},
    }  # fmt: skip


def named(effect, joint="j2", equivalent=(), **parameters):
    return {"joint": joint, "effect": effect, "equivalent": list(equivalent), "depends_on": [],
            "parameters": parameters, "error_reduction": 0.5}  # fmt: skip


def say(*entries, before=4.0, after=2.5):
    joint = {"unit": "N m", "rms_before": before, "rms_after": after, "noise_floor": None,
             "test_runs": {"runs/r2.parquet": [before, after]}}  # fmt: skip
    return {"dataset": "d1", "verdict": list(entries), "joints": {"j1": joint, "j2": joint}}


@pytest.mark.parametrize(
    ("entries", "outcome", "correct", "extra"),
    [
        ([named("stribeck")], "right", True, 0),
        ([named("concave_viscous", equivalent=["stribeck"])], "equivalent", True, 0),
        ([], "none", False, 0),
        ([named("unknown")], "unknown", False, 0),
        ([named("concave_viscous")], "wrong", False, 1),
        ([named("stribeck", joint="j1")], "wrong", False, 1),
        ([named("stribeck"), named("backlash", joint="j1")], "right", True, 1),
    ],
)
def test_outcome_of_a_single_effect(entries, outcome, correct, extra):
    (row,) = score_case(make_truth(plant()), say(*entries))
    assert (row["outcome"], row["correct"], row["extra_named"]) == (outcome, correct, extra)


def test_a_wrong_name_before_the_right_one_is_not_first():
    (late,) = score_case(make_truth(plant()), say(named("backlash", "j1"), named("stribeck")))
    (early,) = score_case(make_truth(plant()), say(named("stribeck"), named("backlash", "j1")))
    assert (late["first"], early["first"]) == (False, True)


@pytest.mark.parametrize(
    ("entries", "outcome", "correct"),
    [([], "none", True), ([named("unknown")], "unknown", False), ([named("stribeck")], "wrong", False)],
)
def test_outcome_of_a_null(entries, outcome, correct):
    (row,) = score_case(make_truth(), say(*entries))
    assert (row["kind"], row["outcome"], row["correct"]) == ("null", outcome, correct)


@pytest.mark.parametrize(
    ("entries", "outcome", "correct"),
    [
        ([named("unknown")], "unknown", True),
        ([named("unknown", joint="j1")], "none", False),
        ([named("stribeck")], "wrong", False),
        ([], "none", False),
    ],
)
def test_outcome_of_an_outside_effect(entries, outcome, correct):
    (row,) = score_case(make_truth(plant("sticking_spot", outside=True)), say(*entries))
    assert (row["outcome"], row["correct"]) == (outcome, correct)


def test_outside_effect_is_never_right_by_its_own_name():
    (row,) = score_case(make_truth(plant("sticking_spot", outside=True)), say(named("sticking_spot")))
    assert row["outcome"] == "wrong"


def test_pairs_give_a_row_each():
    truth = make_truth(plant("stribeck", "j1"), plant("torque_offset", "j2"))
    rows = score_case(truth, say(named("torque_offset", "j2")))
    assert [row["outcome"] for row in rows] == ["none", "right"]
    assert {row["kind"] for row in rows} == {"pair"}


@pytest.mark.parametrize(
    ("stated", "error", "covered"),
    [
        ({"value": 2.2, "ci95": [1.9, 2.5], "unit": "N m"}, 0.1, 1.0),
        ({"value": 2.2, "ci95": [2.1, 2.5], "unit": "N m"}, 0.1, 0.0),
        ({"value": 2200.0, "ci95": [1900, 2500], "unit": "N mm"}, np.nan, np.nan),
    ],
)
def test_parameters_are_compared_where_the_unit_agrees(stated, error, covered):
    truth = make_truth(plant("torque_offset", parameters={"offset": {"value": 2.0, "unit": "N m"}}))
    (row,) = score_case(truth, say(named("torque_offset", offset=stated)))
    assert row["parameter_error"] == pytest.approx(error, nan_ok=True)
    assert row["covered"] == pytest.approx(covered, nan_ok=True)


def test_equal_units_may_be_written_differently():
    truth = make_truth(plant("rotor_inertia_error", parameters={"inertia": {"value": 2.0, "unit": "kg m^2"}}))
    stated = {"value": 2.0, "ci95": [1.9, 2.1], "unit": "N m s^2/rad"}
    (row,) = score_case(truth, say(named("rotor_inertia_error", inertia=stated)))
    assert row["covered"] == 1.0


def test_gap_is_closed_in_variance_towards_the_noise():
    (row,) = score_case(make_truth(plant()), say(named("stribeck"), before=4.0, after=2.0))
    assert row["gap_closure"] == pytest.approx(1.0)
    (half,) = score_case(make_truth(plant()), say(named("stribeck"), before=4.0, after=np.sqrt(10)))
    assert half["gap_closure"] == pytest.approx(0.5)
    (none,) = score_case(make_truth(plant()), say(named("stribeck"), before=2.0, after=2.0))
    assert np.isnan(none["gap_closure"])


def test_the_floor_is_that_of_the_readers_own_filter():
    rng = np.random.default_rng(0)
    t = np.arange(4000) / 250.0
    clean, noise = 30 * np.sin(t) + 5 * np.sign(np.sin(3 * t)), rng.normal(size=4000)
    truth = make_truth(plant())
    truth["signals"] = {
        "run": np.ones(4000), "t": t, "clean_j2": clean, "noise_j2": noise,
    }  # fmt: skip
    sos = butter(3, 12.0, fs=250.0, output="sos")
    kept = slice(300, -300, 3)
    shown = sosfiltfilt(sos, clean + noise)[kept]
    residual = pd.DataFrame({"t": t[kept], "run": "runs/r2.parquet", "joint": "j2", "measured": shown})
    expected = np.sqrt(np.mean(sosfiltfilt(sos, noise)[kept] ** 2))
    assert true_floor(residual, truth, "j2")[1] == pytest.approx(expected, rel=0.01)
    raw = residual.assign(measured=(clean + noise)[kept])
    assert true_floor(raw, truth, "j2")[1] == pytest.approx(np.sqrt(np.mean(noise[kept] ** 2)), rel=1e-6)


def test_a_nonlinear_reader_gets_no_floor():
    t = np.arange(4000) / 250.0
    clean = 30 * np.sin(t)
    truth = make_truth(plant())
    noise = np.random.default_rng(0).normal(size=4000)
    truth["signals"] = {"run": np.ones(4000), "t": t, "clean_j2": clean, "noise_j2": noise}
    residual = pd.DataFrame({"t": t, "run": "r2", "joint": "j2", "measured": (clean + noise) ** 2})
    assert true_floor(residual, truth, "j2") == {}


def test_bounds_are_clopper_and_pearsons():
    assert upper_bound(0, 300) == pytest.approx(1 - 0.05 ** (1 / 300))
    assert bound_share(0, 10)[1] == pytest.approx(1 - 0.025 ** (1 / 10))
    assert bound_share(10, 10) == pytest.approx((0.025 ** (1 / 10), 1.0))
    assert bound_share(5, 10) == pytest.approx((0.187086, 0.812914), abs=1e-5)
    assert bound_share(0, 0) == (0.0, 1.0)


def board_rows():
    rows = []
    for size, answer in ((1.0, "backlash"), (2.0, "unknown"), (4.0, "stribeck"), (8.0, "stribeck")):
        truth = make_truth(plant(size=size), dataset=f"p{size}")
        rows += score_case(truth, say(named(answer)))
    for number in range(4):
        said = [named("stribeck")] if number == 0 else []
        rows += score_case(make_truth(dataset=f"n{number}", noise="drift"), say(*said))
    outside = make_truth(plant("sticking_spot", outside=True), dataset="o1")
    rows += score_case(outside, say(named("unknown")))
    return pd.DataFrame(rows)


def test_tables_of_a_small_board():
    rows = board_rows()
    confusion = tabulate_confusion(rows).set_index(["truth", "answer"])["count"]
    assert confusion["stribeck", "stribeck"] == 2
    assert confusion["stribeck", "backlash"] == 1
    assert confusion["stribeck", "unknown"] == 1
    assert confusion["null:drift", "none"] == 3
    assert confusion["outside:sticking_spot", "unknown"] == 1
    assert confusion.sum() == len(rows)
    sizes = find_smallest_sizes(rows)
    assert sizes["smallest_size"].tolist() == [4.0]
    figures = summarise(rows)["tracer"]
    assert figures["named"]["4 and more"]["right"]["share"] == 1.0
    assert figures["named"]["1"]["right"]["share"] == 0.0
    assert figures["false_attribution"]["hits"] == 1
    assert figures["false_attribution"]["cases"] == 4
    assert figures["wrong_name"]["hits"] == 1
    assert figures["outside_unknown"]["share"] == 1.0
    text = write_markdown(summarise(rows), sizes)
    assert "| stribeck | 4 |" in text
    assert "25.0 % (1/4" in text


def test_a_verdict_that_is_none_is_refused(tmp_path):
    path = tmp_path / "verdict.json"
    with pytest.raises(InputError, match="close the loop on the data set first"):
        read_verdict(path)
    path.write_text("{")
    with pytest.raises(InputError, match=r"no JSON \(line 1\)"):
        read_verdict(path)
    path.write_text('{"verdict": []}')
    with pytest.raises(InputError, match="has no 'joints'"):
        read_verdict(path)
