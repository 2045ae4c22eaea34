"""The page of a reevaluation, and its summary on the study's first page."""

import numpy as np
import pandas as pd
import pytest

from wearscope.evaluation.reevaluation import Reevaluation
from wearscope.reporting.findings import compare_with_paper
from wearscope.reporting.reevaluation_page import (
    count_truth,
    list_sides,
    render_reevaluation,
    snr_sides,
    tell_headline,
)
from wearscope.reporting.study_page import render_study


def row(fda, question, before, after, truth, p_changed, p_nearer, about="", delta=np.nan, unit="1"):
    sides = {"before": before, "after": after, "truth": truth}
    ends = {
        f"{side}_{end}": value * k
        for side, value in sides.items()
        for end, k in (("low", 0.9), ("high", 1.1))
    }
    place = {"robot": "twin<1>", "cycle": "c", "axis": 2, "fda": fda, "withheld": False}
    asked = {"question": question, "about": about, "delta": delta, "unit": unit}
    return {**place, **asked, **sides, **ends, "p_changed": p_changed, "p_nearer": p_nearer}


@pytest.fixture
def table():
    return pd.DataFrame(
        [
            row("A", "snr", 2.0, 9.0, 9.5, 1.0, 1.0),
            row("A", "rank", 2.0, 1.0, 1.0, 1.0, 1.0),
            row("A", "scope", 1.0, 6.0, 7.0, 0.99, 0.98, "w3", 12.5, "degC"),
            row("A", "coefficient", 1.6, 0.3, 0.28, 0.99, 0.97, "w3"),
            row("B", "snr", 5.0, 5.1, 5.0, 0.1, 0.5),
            row("B", "rank", 1.0, 2.0, 2.0, 1.0, 1.0),
            row("B", "scope", 4.0, 4.0, 4.0, 0.0, 0.5, "w3", 12.5, "degC"),
            row("B", "coefficient", 0.1, 0.1, 0.1, 0.0, 0.5, "w3"),
        ]
    )


@pytest.fixture
def ranking():
    pairs = [("A", "B", 0.01, 0.99, 0.99), ("B", "A", 0.99, 0.01, 0.01)]
    return pd.DataFrame(
        [("twin<1>", "c", 2, *pair) for pair in pairs],
        columns=["robot", "cycle", "axis", "fda", "over", "before", "after", "truth"],
    )


@pytest.fixture
def one(table, ranking):
    models = pd.DataFrame(
        {"side": ["before", "after", "truth"], "drawn": [3, 2, 0], "left_out": [0, 1, 0],
         "first_reason": ["", "it <fell> over.", ""]}
    )  # fmt: skip
    return Reevaluation(table, ranking, models, ("wear at axis_2",))


NO_SURROGATES = pd.DataFrame(columns=["robot", "axis", "fda", "kind", "fit", "state", "n_points"])
TRUTH = ["truth", "truth_low", "truth_high", "p_nearer"]
#: How each case changes the table of answers and that of ranks.
CASES = {
    "the correction changes two answers": lambda table, ranking: None,
    "no SNR surely changes": lambda table, ranking: table.__setitem__("p_changed", 0.5),
    "either may be the best before": lambda table, ranking: ranking.__setitem__("before", 0.5),
    "one is the best on both sides": lambda table, ranking: ranking.__setitem__("after", [0.01, 0.99]),
    "a scope goes the other way": lambda table, ranking: table.loc.__setitem__((2, "p_nearer"), 0.01),
    "there is no truth": lambda table, ranking: table.__setitem__(TRUTH, np.nan),
}


@pytest.mark.parametrize("case", CASES)
def test_the_page_says_what_surely_changes_and_which_side_is_nearer_to_the_truth(
    case, one, table, ranking, says
):
    CASES[case](table, ranking)
    says(case, tell_headline(one), count_truth(one), render_reevaluation(one, NO_SURROGATES))


def test_the_page_stands_alone_and_escapes(one):
    chosen = pd.DataFrame(
        {"robot": ["before"], "axis": [2], "fda": ["A"], "kind": ["gaussian_process"], "fit": [97.0],
         "state": ["reached"], "n_points": [50]}
    )  # fmt: skip
    page = render_reevaluation(one, chosen)
    assert "twin&lt;1&gt;" in page and "<fell>" not in page
    assert "wear at axis_2" in page and "1 more left out" in page
    assert '<span class="badge good">nearer: SNR, rank and scope</span>' in page
    assert "&lt;span" not in page
    assert 'id="sides-chart"' in page


def test_the_chart_has_each_detector_on_each_side(one):
    sides = snr_sides(one)
    assert list_sides(one) == ["before", "after", "truth"] and len(sides) == 6
    own = sides[sides["thing"] == "A, axis 2"].set_index("side")
    assert own["value"].to_list() == [2.0, 9.0, 9.5] and own.loc["after", "high"] == pytest.approx(9.9)


def test_the_study_s_first_page_says_what_the_correction_changes(one, change):
    study = change(reevaluation=one)
    page = render_study(study, compare_with_paper(study))
    summary = (
        page[: page.index("Compared with the paper</h2>")] if "Compared with the paper</h2>" in page else page
    )
    assert (
        "What the correction changes" in summary
        and "The corrected model is nearer to the truth for 2 of 2" in summary
    )
    assert "What the correction changes" not in render_study(change(), compare_with_paper(change()))


def test_a_dropped_factor_stands_on_the_first_page(change):
    screening = pd.DataFrame(
        {"robot": ["medium", "large"], "factor": ["w5", "w5"], "kind": "payload_mass_error",
         "change": [0.0, 0.1], "moves": [False, True], "dropped": [True, False]}
    )  # fmt: skip
    study = change(screening=screening)
    page = render_study(study, compare_with_paper(study))
    assert "Payload error moves no recorded torque of medium" in page
