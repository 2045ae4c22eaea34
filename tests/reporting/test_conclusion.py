from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from wearscope.evaluation.conclusion import Bound, Conclusion
from wearscope.reporting.conclusion import certainty, conclude, qualify
from wearscope.reporting.findings import compare_with_paper
from wearscope.reporting.study_page import render_study


@pytest.fixture
def found():
    bounds = [Bound("w3", 2.04, False), Bound("w5", 5.0, True)]
    return Conclusion("", "C", [], [], 20.0, bounds, 8, 8, True, 0.01, 0.99)


@pytest.fixture
def told(study):
    """The study with thresholds of its cells."""
    rows = [
        ("medium", "a", 1, "C", 3.1, ""),
        ("medium", "a", 2, "C", 4.0, ""),
        ("large", "a", 1, "C", 9, "large"),
    ]
    columns = ["robot", "cycle", "axis", "fda", "threshold", "asked"]
    return replace(study, thresholds=pd.DataFrame(rows, columns=columns), units={"C": "N m"})


def test_the_conclusion_is_one_sentence_with_units(told, found):
    assert conclude(told, found) == (
        "Use C: it finds a change of wear of 20 or more while temperature stays within ±4 °C or payload "
        "error stays within at least ±9.8 %; alarm threshold 3.1 to 4 N m by cell."
    )
    assert certainty(found) == "good"


def test_it_is_only_as_certain_as_its_parts(told, found):
    tied = replace(found, tied_with=["A"])
    assert "Use C (SNR not told apart from A): it finds" in conclude(told, tied)
    assert certainty(tied) == "unsure" and "not told apart at 95 %" in qualify(told, tied)[0]
    some = replace(found, cells_sure=5)
    assert "20 or more in 5 of 8 cells while" in conclude(told, some) and certainty(some) == "unsure"
    guess = replace(found, shown_sure=False)
    assert "Use C: by the estimates alone, it finds" in conclude(told, guess)
    assert certainty(guess) == "unsure" and "not counted" in " ".join(qualify(told, guess))


def test_nothing_found_and_nothing_recommended_are_answers(told, found):
    blind = replace(found, wear=np.nan, bounds=[])
    assert "no change of wear that was asked is surely found" in conclude(told, blind)
    assert certainty(blind) == "bad"
    none = replace(blind, detector="", withheld=["A", "C"])
    assert conclude(told, none) == ("No detector can be recommended: the answers of A and C are withheld.")
    assert "none sees wear" in conclude(told, replace(none, withheld=[]))


def test_a_robot_s_conclusion_has_its_own_threshold(told, found):
    text = conclude(told, replace(found, robot="large"))
    assert text.startswith("On large: Use C") and text.endswith("alarm threshold 9 N m.")


def test_the_page_begins_with_it(asked):
    page = render_study(asked, compare_with_paper(asked))
    first = page[page.index('<section id="summary"') :]
    place = first.index('class="answer"')
    assert first.index("Use ") > place and place < first.index('class="card"')
    assert "not asked" not in page[: page.index('<script type="application/json" id="settings">')]
