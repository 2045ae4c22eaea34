import shlex
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import yaml

from wearscope.config import load_config
from wearscope.evaluation.conclusion import Bound, Conclusion
from wearscope.reporting.conclusion import (
    certainty,
    conclude,
    friction_rise,
    qualify,
    study_strip,
    tell_friction,
    tell_sure,
    thresholds_of,
)  # fmt: skip
from wearscope.reporting.findings import compare_with_paper
from wearscope.reporting.study_page import render_study
from wearscope.reporting.trust import ask_moved


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


def test_the_conclusion_is_plain_sentences_with_units(told, found):
    assert conclude(told, found) == ("Use Friction fit (C). It finds wear of 20 or more.")
    assert tell_sure(told, found).endswith(
        "This holds while one factor varies: temperature within ±4 °C or payload error within ±9.8 % or more."
    )
    assert certainty(found) == "good"


def test_it_is_only_as_certain_as_its_parts(told, found):
    tied = replace(found, tied_with=["A"])
    assert "Friction fit (C), not told apart from Residual energy (A). It finds" in conclude(told, tied)
    assert certainty(tied) == "unsure" and "not told apart at 95 %" in qualify(told, tied)[0]
    some = replace(found, cells_sure=5)
    assert (
        "20 or more, in 5 of 8 combinations of robot, test-cycle and axis." in conclude(told, some)
        and certainty(some) == "unsure"
    )
    guess = replace(found, shown_sure=False)
    assert "(C). By the estimates alone, it finds" in conclude(told, guess)
    assert certainty(guess) == "unsure" and "not counted" in tell_sure(told, guess)


def test_a_better_detector_that_is_withheld_is_told_on_top(told, found):
    """The second best is recommended then: the strip is unsure, and says whose SNR is larger."""
    medians = [("", "C", 2.0), ("", "A", 3.0), ("", "B", 1.0), ("large", "B", 9.0)]
    ranked = replace(told, rankings=pd.DataFrame(medians, columns=["robot", "fda", "median"]))

    def top(withheld):
        return study_strip(replace(ranked, conclusions=[replace(found, withheld=withheld)]))

    assert top(["A"]).kind == "unsure"
    assert top(["A", "B"]).caveat == (
        "Residual energy (A) has a larger signal-to-noise ratio and is withheld: direct simulation "
        "contradicts its surrogate."
    )
    assert top(["B"]).kind == "good" and "withheld" not in top(["B"]).caveat


def test_nothing_found_and_nothing_recommended_are_answers(told, found):
    blind = replace(found, wear=np.nan, bounds=[])
    assert "no change of wear that was simulated is surely found" in conclude(told, blind)
    assert certainty(blind) == "bad"
    none = replace(blind, detector="", withheld=["A", "C"])
    assert conclude(told, none) == (
        "No detector can be recommended: "
        "the answers of Residual energy (A) and Friction fit (C) are withheld."
    )
    assert "none sees wear" in conclude(told, replace(none, withheld=[]))


def test_a_robot_s_conclusion_names_it(told, found):
    assert conclude(told, replace(found, robot="large")).startswith("On large: Use Friction fit (C)")
    assert list(thresholds_of(told, replace(found, robot="large"))["threshold"]) == [9]


def test_wear_is_told_as_friction(told):
    speeds = np.array([0.1, 0.5, 1.0])
    rows = [
        ("medium", joint, speed, 50.0, wear, torque * (1 + rise * wear / 50))
        for joint, torque, rise in (("a", 10.0, 0.2), ("b", 40.0, 0.5))
        for speed in speeds
        for wear in (0.0, 25.0, 50.0)
    ]
    columns = ["robot", "joint", "speed", "temperature", "wear", "torque"]
    study = replace(told, friction=pd.DataFrame(rows, columns=columns))
    assert friction_rise(study, 20.0) == pytest.approx((0.08, 0.2))
    assert tell_friction(study, 20.0) == ", which is 8 to 20 % more friction at a tenth of the top speed"
    assert friction_rise(told, 20.0) is None and tell_friction(told, 20.0) == ""


def test_an_upper_bound_is_told_and_not_recommended(told, found):
    bound = replace(found, upper=["A"])
    assert "Residual energy (A) is told the friction law" in " ".join(qualify(told, bound))
    alone = replace(found, detector="", wear=np.nan, bounds=[], upper=["A", "C"])
    assert conclude(told, alone) == (
        "No detector can be recommended: apart from Residual energy (A) and Friction fit (C), which are "
        "told the simulator's law, none sees wear."
    )


def test_the_page_begins_with_it(asked):
    page = render_study(asked, compare_with_paper(asked))
    top = page[page.index("<header>") : page.index("<main")]
    assert 'class="answer">Use Friction fit (C)' in top or 'class="answer">Use ' in top
    for heading in ("How sure", "Mind", "Next"):
        assert f"<dt>{heading}</dt>" in top
    assert 'href="#thresholds"' in top and 'id="thresholds"' in page


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({}, "Everything is simulated"),
        ({"sources": {"arm": ["URDF given; friction assumed"]}}, "a robot with the numbers assumed for arm"),
        ({"sources": {"arm": ["assumed"], "medium": ["paper"]}}, "arm has assumed numbers"),
    ],
)
def test_the_strip_names_the_caveat_that_matters(told, found, fields, said):
    study = replace(told, conclusions=[found], audit=None, audit_answers=None, **fields)
    assert said in study_strip(study).caveat


def test_what_is_assumed_and_how_far_the_answer_moves_are_on_the_headline(told, found):
    arm = {"arm": ["URDF given; friction assumed"]}
    study = replace(told, conclusions=[found], audit=None, audit_answers=None, sources=arm)
    assert study_strip(study).answer.endswith("Some numbers of the robot are assumed.")
    assert "is not judged; the part on trust has the command." in study_strip(study).caveat
    path = "effects.friction_wear_temperature.all.eta0 %"
    command = ask_moved(study)[0].striptags().partition("changes, run ")[2].partition("; ")[0]
    setting = yaml.safe_load(shlex.split(command)[-1].partition("=")[2])
    assert load_config(told.config | {"direct": {"mismatch": setting}}).direct.mismatch == {path: 100}
    row = {"robot": "arm", "cycle": "a", "axis": 1, "fda": ["C"], "snr_ideal": 9.0, "snr_mismatch": 4.0}
    row |= {"ideal_low": 8.0, "ideal_high": 10.0, "mismatch_low": 3.0, "mismatch_high": 5.0}
    config = told.config | {"direct": told.config["direct"] | {"mismatch": {path: 100.0}}}
    study = replace(study, mismatch=pd.DataFrame(row), config=config)
    assert study_strip(study).caveat.endswith(
        "With Coulomb friction changed by +100 %, Friction fit (C) has a signal-to-noise ratio of 4 (3 to 5) "
        "instead of 9 (8 to 10), at a, axis 1."
    )
    assert not ask_moved(study)
    given = replace(study, sources={"arm": ["paper"]})
    assert study_strip(given).answer.endswith("The robot's numbers are given.") and not ask_moved(given)


def test_a_direct_value_that_disagrees_is_the_answer(told, found):
    direct = pd.DataFrame(
        {"robot": "medium", "cycle": "a", "axis": 1, "fda": ["C"], "snr_direct": [42.0], "direct_low": [40.0],
         "direct_high": [45.0], "snr_surrogate": [32.0], "agrees": [False], "surrogate_low": [30.0],
         "surrogate_high": [34.0], "runs": [60]}
    )  # fmt: skip
    study = replace(told, conclusions=[found], direct=direct, audit=None)
    assert "is 42 (40 to 45); the surrogate says 32. The direct value" in study_strip(study).caveat
    page = render_study(study, compare_with_paper(study))
    assert "the direct value answers" in page
    agreed = replace(study, direct=direct.assign(agrees=True))
    assert "direct value" not in study_strip(agreed).caveat
