"""Sides with planted answers: what changes is found, what does not is not, and nearer means nearer."""

import numpy as np
import pandas as pd
import pytest
from scipy.special import ndtri

from wearscope.designs.factors import PAPER_FACTORS
from wearscope.designs.kinds import checking_design, filling_design, make_design
from wearscope.evaluation.reevaluation import (
    Answers,
    Questions,
    Reevaluation,
    _probabilities,
    _probability,
    answer_side,
    best_detectors,
    compare_ranking,
    compare_sides,
    extend_to_drawn,
    judge_detector,
    rank_best,
    share_surrogates,
    withheld_cells,
)
from wearscope.evaluation.sampled_scope import largest_passing
from wearscope.reporting.reevaluation_page import count_truth, tell_headline, tell_withheld
from wearscope.surrogates.chosen import choose_surrogates

NAMES = [factor.name for factor in PAPER_FACTORS]
ASKED = Questions(
    PAPER_FACTORS,
    "main",
    {"f0": -0.5, "delta": 1.0, "sigma": 0.25},
    {"factors": ["w3"], "f0": -2.0, "sigma": (0.01, 1.0), "grid": (30, 100), "p_f": 0.01, "p_d": 0.99},
    draws=120,
)
NOISE = 0.02
#: Of the response, which is linear; others are asked in the room of the surrogates.
KINDS = ["quadratic"]
DESIGNS = {
    "identification": filling_design(PAPER_FACTORS, 24, 3, 4, axes=(1,)),
    "filling": make_design("latin_hypercube", PAPER_FACTORS, {"points": 11, "stream": "bridge"}, 0),
    "checking": checking_design(PAPER_FACTORS, 10, 1, axes=(1,)),
}


def runs(robot, slopes, sets=tuple(DESIGNS), noise=NOISE, extra=0.0):
    """Test quantities y = f + b w3 (+ extra w1) by detector; every side has the same noise."""
    parts = []
    for fda, slope in slopes.items():
        for name in sets:
            table = DESIGNS[name][["point", *NAMES]].copy()
            stream = np.random.default_rng([len(name), ord(fda)])
            y = table["f"] + slope * table["w3"] + extra * table["w1"]
            table["y"] = y + noise * stream.standard_normal(len(table))
            parts.append(table.assign(robot=robot, cycle="c", axis=1, fda=fda, set=name, status="ok"))
    return pd.concat(parts, ignore_index=True)


def choose(quantities):
    return choose_surrogates(quantities, PAPER_FACTORS, KINDS)


def ask(side, slopes, drawn=None, **options):
    quantities = runs(side, slopes, **options)
    return answer_side(side, quantities, choose(quantities), drawn, ASKED)


def expected_snr(slope, noise=NOISE):
    return 1.0 / np.hypot(0.25 * slope, noise)


@pytest.fixture(scope="module")
def sides():
    """The correction turns the order round; the truth is near to after."""
    return {
        "before": ask("before", {"A": 0.1, "B": 0.9}),
        "after": ask("after", {"A": 0.8, "B": 0.2}),
        "truth": ask("truth", {"A": 0.75, "B": 0.22}),
    }


@pytest.fixture(scope="module")
def reevaluation(sides):
    table, ranking = compare_sides(sides, "r", PAPER_FACTORS), compare_ranking(sides, "r")
    models = pd.DataFrame({"side": list(sides), "drawn": 0, "left_out": 0, "first_reason": ""})
    return Reevaluation(table, ranking, models)


def rows(table, question, fda="A", about=""):
    return table[(table["question"] == question) & (table["fda"] == fda) & (table["about"] == about)]


def test_the_snr_is_that_of_single_runs(reevaluation):
    for fda, slopes in {"A": (0.1, 0.8), "B": (0.9, 0.2)}.items():
        row = rows(reevaluation.table, "snr", fda).iloc[0]
        assert row["before"] == pytest.approx(expected_snr(slopes[0]), rel=0.15)
        assert row["after"] == pytest.approx(expected_snr(slopes[1]), rel=0.15)
        assert row["before_low"] <= row["before"] <= row["before_high"]


def test_coefficients_are_those_planted(reevaluation):
    row = rows(reevaluation.table, "coefficient", "A", "w3").iloc[0]
    assert row["before"] == pytest.approx(0.1, abs=0.02)
    assert row["after"] == pytest.approx(0.8, abs=0.02)
    assert row["p_changed"] == 1.0
    other = rows(reevaluation.table, "coefficient", "A", "w4").iloc[0]
    assert other["p_changed"] < 0.95


def test_the_scope_is_the_closed_form_s_in_natural_units(reevaluation):
    """A change d is told at 1 % and 99 % while d >= b sigma (z + z); one coded unit of w3 is 10 K."""
    table = rows(reevaluation.table, "scope", "A", "w3")
    one = table[table["delta"] == 12.5].iloc[0]
    expected = 10.0 / (2.0 * ndtri(0.99) * 0.8)
    assert one["after"] == pytest.approx(expected, rel=0.08)
    assert one["before"] == pytest.approx(10.0)  # 21 K would be borne; the grid ends at 10
    assert one["unit"] == "degC"


def test_the_order_turns_round_and_the_sentences_say_so(reevaluation):
    assert best_detectors(reevaluation, "before") == {("c", 1): ["A"]}
    assert best_detectors(reevaluation, "after") == {("c", 1): ["B"]}
    assert rows(reevaluation.table, "rank", "A").iloc[0][["before", "after"]].tolist() == [1.0, 2.0]
    assert "changes on axis 1 (c): A before, B after" in tell_headline(reevaluation)


def test_each_detector_is_set_against_each_other_of_its_cell_once(sides):
    """Also where a further cell has detectors of its own."""
    one = compare_ranking(sides, "r")
    assert one[["fda", "over"]].to_numpy().tolist() == [["A", "B"], ["B", "A"]]
    wider = {side: Answers(dict(one.value), dict(one.drawn)) for side, one in sides.items()}
    for answers in wider.values():
        for key in [key for key in answers.value if key[2] == "A"]:
            place = ("other", 2, "own", *key[3:])
            answers.value[place], answers.drawn[place] = answers.value[key], answers.drawn[key]
    pd.testing.assert_frame_equal(compare_ranking(wider, "r"), one)


def test_after_is_nearer_to_a_truth_beside_it(reevaluation):
    for fda in "AB":
        assert rows(reevaluation.table, "snr", fda).iloc[0]["p_nearer"] >= 0.95
    assert judge_detector(rows(reevaluation.table, "snr"))[1] == "nearer"
    assert "nearer to the truth for 2 of 2 detectors and axes, farther for none" in count_truth(reevaluation)


def test_a_correction_that_goes_the_wrong_way_is_told(sides):
    wrong = {"before": sides["after"], "after": sides["before"], "truth": sides["truth"]}
    table = compare_sides(wrong, "r", PAPER_FACTORS)
    assert rows(table, "snr").iloc[0]["p_nearer"] <= 0.05
    said = count_truth(Reevaluation(table, compare_ranking(wrong, "r"), pd.DataFrame()))
    assert said.endswith("nearer to the truth for none of 2 detectors and axes, farther for 2.")


def test_a_correction_that_changes_nothing_changes_no_answer(sides):
    same = {"before": sides["after"], "after": ask("after", {"A": 0.8, "B": 0.2}), "truth": sides["truth"]}
    table = compare_sides(same, "r", PAPER_FACTORS)
    assert (table["p_changed"] < 0.95).all()
    assert not table["p_nearer"].between(0.95, 1.0).any()
    one = Reevaluation(table, compare_ranking(same, "r"), pd.DataFrame())
    assert tell_headline(one).startswith("The best detector stays the same.")
    assert tell_headline(one).endswith("No change of a signal-to-noise ratio is sure.")


def test_without_a_truth_no_side_is_called_nearer(sides):
    two = {side: sides[side] for side in ("before", "after")}
    table = compare_sides(two, "r", PAPER_FACTORS)
    assert table[["truth", "p_nearer"]].isna().all(axis=None)
    said = count_truth(Reevaluation(table, compare_ranking(two, "r"), pd.DataFrame()))
    assert said == "The truth of a real machine is unknown, so which side is nearer to it cannot be said."


def test_drawn_models_take_the_rest_of_their_response_from_the_side_s_own():
    own = runs("after", {"A": 0.5})
    few = runs("after-01", {"A": 0.8}, sets=("filling",), extra=0.3)
    ((name, extended, chosen),) = extend_to_drawn(own, choose(own), few, "after")
    assert name == "after-01" and set(chosen["robot"]) == {"after-01"}
    expected = runs("after-01", {"A": 0.8}, extra=0.3)
    np.testing.assert_allclose(extended["y"], expected["y"], atol=1e-9)


def test_a_drawn_model_is_bridged_from_as_many_runs_as_a_constant_and_main_effects_have():
    """With one run more than there are factors the bridge goes through them all; with one less it is open."""
    own, expected = runs("after", {"A": 0.5}), runs("after-01", {"A": 0.8}, extra=0.3)
    few = runs("after-01", {"A": 0.8}, sets=("filling",), extra=0.3)
    enough = few["point"] <= len(NAMES) + 1
    few["y"] = few["y"].where(enough)
    ((_, extended, _),) = extend_to_drawn(own, choose(own), few, "after")
    np.testing.assert_allclose(extended["y"], expected["y"], atol=1e-9)
    few["y"] = few["y"].where(few["point"] <= len(NAMES))
    assert few["y"].notna().sum() == len(NAMES)
    assert list(extend_to_drawn(own, choose(own), few, "after")) == []


def test_what_the_model_leaves_open_widens_the_answer():
    few = pd.concat(
        [runs(f"after-0{k}", {"A": slope}, ("filling",)) for k, slope in enumerate((0.2, 0.4, 0.8, 1.2))]
    )
    alone, open_ = ask("after", {"A": 0.5}), ask("after", {"A": 0.5}, few)
    key = ("c", 1, "A", "snr", "", 0.0)
    low, high = np.quantile(open_.drawn[key], [0.025, 0.975])
    assert low < 1.15 * expected_snr(1.2) and high > 0.85 * expected_snr(0.2)
    assert np.ptp(np.quantile(alone.drawn[key], [0.025, 0.975])) < 0.3 * (high - low)
    assert open_.value[key] == pytest.approx(alone.value[key], rel=0.05)


def test_a_model_without_noise_has_no_snr():
    answers = ask("after", {"A": 0.5}, noise=0.0)
    assert np.isnan(answers.value["c", 1, "A", "snr", "", 0.0])
    assert np.isnan(answers.value["c", 1, "A", "rank", "", 0.0])


def test_sides_share_the_parameters_of_the_one_that_fits_worst():
    tables = [choose(runs(side, {"A": slope}, noise=noise)) for side, slope, noise in
              (("before", 0.5, 0.02), ("after", 0.5, 0.3))]  # fmt: skip
    shared = share_surrogates(pd.concat(tables))
    assert shared["parameters"].nunique() == 1
    assert shared["parameters"].iloc[0] == tables[1]["parameters"].iloc[0]


def test_a_surrogate_that_misses_its_checks_is_withheld(sides):
    chosen = choose(runs("before", {"A": 0.5, "B": 0.5}))
    assert not withheld_cells(chosen)
    chosen.loc[chosen["fda"] == "A", "inside"] = 0.3
    assert withheld_cells(chosen) == {("c", 1, "A")}
    table = compare_sides(sides, "r", PAPER_FACTORS, withheld_cells(chosen))
    one = Reevaluation(table, compare_ranking(sides, "r"), pd.DataFrame())
    (told,) = tell_withheld(one)
    assert told.startswith("Withheld") and "A on axis 1" in told
    assert "A on axis" not in tell_headline(one) and "of 1 detector and axis" in count_truth(one)


def test_largest_passing_sigma():
    sigmas = np.array([0.1, 0.2, 0.3])
    passes = np.array([[1, 1, 1], [1, 0, 1], [0, 1, 1], [1, 1, 0]], dtype=bool)
    assert largest_passing(passes, sigmas).tolist() == [0.3, 0.1, 0.0, 0.2]


def test_probabilities_are_shares_of_draws():
    """Of 1, 2, 3 against 1, 1, 4: a tie, which counts half, a larger and a smaller one."""
    first, second = np.array([1.0, 2.0, 3.0]), np.array([1.0, 1.0, 4.0])
    assert _probability(first, second) == 0.5
    assert _probability(first[:2], second) == 0.75
    assert _probability(second, np.array([0.0, np.nan, 4.0])) == 0.75
    assert np.isnan([_probability(first, None), _probability(first, np.full(3, np.nan))]).all()
    # Half as many again up as down are half sure; 1, 4, 2 are off a truth of 3 by 2, 1, 1, after by 1, 1, 2.
    before, after, truth = np.array([1.0, 4.0, 2.0, 0.0]), np.array([2.0, 4.0, 5.0, 1.0]), np.full(3, 3.0)
    changed, nearer = _probabilities(before, after, truth)
    assert changed == pytest.approx(2.0 * 3.5 / 4.0 - 1.0) and nearer == pytest.approx(0.5)
    changed, nearer = _probabilities(after, before, truth + 9.0)
    assert changed == pytest.approx(0.75) and nearer == pytest.approx(0.5 / 3.0)
    assert np.isnan(_probabilities(before, after, None)[1])


def test_an_answer_is_told_in_natural_units_with_its_95_percent(sides):
    """Draws of 0 to 40, of which 1 and 39 are the ends: times 12.5 % of wear or 10 K a coded unit."""
    places = [("c", 1, "A", "scope", "w3", 2.0), ("c", 1, "A", "coefficient", "w3", 0.0)]
    one = Answers(dict.fromkeys(places, 7.0), {place: np.arange(41.0) for place in places})
    other = Answers(dict.fromkeys(places, 9.0), {place: np.arange(41.0) + 50.0 for place in places})
    table = compare_sides({"before": one, "after": other}, "r", PAPER_FACTORS)
    scope, coefficient = (rows(table, what, "A", "w3").iloc[0] for what in ("scope", "coefficient"))
    assert (scope["delta"], scope["unit"], scope["before"], scope["after"]) == (25.0, "degC", 70.0, 90.0)
    assert (scope["before_low"], scope["before_high"]) == pytest.approx((10.0, 390.0))
    assert np.isnan(coefficient["delta"]) and coefficient["before"] == 7.0 and coefficient["unit"] == "1"
    assert (table["p_changed"] == 1.0).all()


def test_a_cell_is_withheld_where_chance_over_all_cells_leaves_it_out():
    """Six or less of ten within their 95 % come once in 972 by chance: within 5 % over 48 cells, not 49."""
    cells = pd.DataFrame({"cycle": "c", "axis": 1, "fda": "A", "n_checking": 10, "inside": 1.0}, range(60))
    cells.loc[0, ["fda", "inside"]] = "B", 0.6
    cells.loc[1, "inside"] = np.nan
    assert withheld_cells(cells[:48]) == {("c", 1, "B")} and withheld_cells(cells[:49]) == set()


def test_equals_share_the_better_rank_and_none_is_none():
    snr = np.array([[3.0, 1.0], [1.0, np.nan], [3.0, 2.0], [2.0, 3.0]])
    np.testing.assert_array_equal(rank_best(snr), [[1.0, 3.0], [4.0, np.nan], [1.0, 2.0], [3.0, 1.0]])
