"""The page of a reevaluation, and its summary on the study's first page."""

import re

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


def test_the_three_answers_are_said_in_words(one):
    chosen = pd.DataFrame(columns=["robot", "axis", "fda", "kind", "fit", "state", "n_points"])
    page = re.sub(r"<[^>]+>", "|", render_reevaluation(one, chosen))
    page = re.sub(r"[|\n]+", "|", page)
    # What surely changed is listed with its intervals; B's factors and scope are not.
    assert "|A|w3|1.6 (1.44 to 1.76)|0.3 (0.27 to 0.33)|" in page and "|B|w3|" not in page
    assert "|A|w3 [°C]|12.5|1 (0.9 to 1.1)|6 (5.4 to 6.6)|" in page


def test_the_page_begins_with_two_short_sentences(one, table):
    best = "The best detector changes on axis 2 (c): B before, A after."
    assert tell_headline(one) == f"{best} The signal-to-noise ratio changes for A on axis 2."
    table["p_changed"] = 0.5
    assert tell_headline(one) == f"{best} The signal-to-noise ratio changes for none."


def test_only_another_best_detector_is_a_change(one, ranking):
    """Before, either may be the best; after, one of them is."""
    ranking["before"] = 0.5
    assert tell_headline(one).startswith("The best detector may be unchanged.")
    ranking[["before", "after"]] = [[0.99, 0.99], [0.01, 0.01]]
    assert tell_headline(one).startswith("The best detector stays the same.")


def test_each_detector_is_set_beside_the_truth(one):
    assert count_truth(one) == (
        "The corrected model is nearer to the truth for 2 of 2 detectors and axes, farther for none."
    )


def test_a_scope_that_goes_the_other_way_is_mixed(one, table):
    table.loc[(table["fda"] == "A") & (table["question"] == "scope"), "p_nearer"] = 0.01
    assert "nearer to the truth for 1 of 2" in count_truth(one)


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


def test_without_a_truth_the_page_names_none(one, table):
    table[["truth", "truth_low", "truth_high", "p_nearer"]] = np.nan
    chosen = pd.DataFrame(columns=["robot", "axis", "fda", "kind", "fit", "state", "n_points"])
    text = render_reevaluation(one, chosen)
    assert "cannot be simulated" in text and "in truth" not in text


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
