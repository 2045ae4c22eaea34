import re
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
    friction_rise,
    qualify,
    reach_of_shifts,
    study_strip,
    thresholds_of,
)  # fmt: skip
from wearscope.reporting.findings import compare_with_paper
from wearscope.reporting.study_page import render_study
from wearscope.reporting.trust import ask_moved


@pytest.fixture
def found():
    """Bears 19.6 degrees of the 20 that the study varies, and 9.8 % of payload, where the grid ends."""
    bounds = [Bound("w3", 10.0, False), Bound("w5", 5.0, True)]
    return Conclusion("", "C", [], [], 20.0, bounds, 8, 8, True, 0.01, 0.99, [], 19, 20, 7)


@pytest.fixture
def told(study):
    """The study with thresholds of its cells, and a declared shift that stays within what is found."""
    rows = [
        ("medium", "a", 1, "C", 3.1, ""),
        ("medium", "a", 2, "C", 4.0, ""),
        ("large", "a", 1, "C", 9, "large"),
    ]
    columns = ["robot", "cycle", "axis", "fda", "threshold", "asked"]
    thresholds = pd.DataFrame(rows, columns=columns)
    return declare(replace(study, thresholds=thresholds, units={"C": "N m"}), [40.0, 60.0])


def declare(study, shift):
    """The study with a declared shift of its temperature."""
    factors = study.config["factors"]
    factors = factors | {"w3": factors["w3"] | {"shift": shift}}
    return replace(study, config=study.config | {"factors": factors})


def top(study, *conclusions):
    return study_strip(replace(study, conclusions=conclusions))


def test_the_conclusion_is_plain_sentences_with_units(told, found):
    strip = top(told, found)
    assert strip.answer == (
        "Use Friction fit (C). It finds wear of 20 or more, while one factor varies: temperature within "
        "±20 °C or payload error within ±9.8 % or more."
    )
    assert strip.sure == (
        "The same detector comes out in 19 of 20 resamplings, and has the largest signal-to-noise ratio in 7 "
        "of 8 combinations of robot, test-cycle and axis. At most 1 % false alarms and at least 99 % "
        "detection for every robot, test-cycle and axis, with 95 % confidence in the surrogates."
    )
    assert strip.kind == "good"


def test_it_is_only_as_certain_as_its_parts(told, found):
    tied = top(told, replace(found, tied_with=["A"]))
    assert "Friction fit (C), not told apart from Residual energy (A). It finds" in tied.answer
    assert tied.kind == "unsure"
    assert (
        "not told apart at 95 %" in qualify(replace(told, conclusions=[replace(found, tied_with=["A"])]))[0]
    )
    some = top(told, replace(found, cells_sure=5))
    assert "in 5 of 8 combinations of robot, test-cycle and axis, with" in some.sure and some.kind == "unsure"
    guess = top(told, replace(found, shown_sure=False))
    assert "(C). By the estimates alone, it finds" in guess.answer
    assert guess.kind == "unsure" and "not counted" in guess.sure
    for agree, kind in ((18, "good"), (17, "unsure")):
        assert certainty(told, replace(found, agree=agree)) == kind


def test_what_a_detector_stands_is_set_against_a_shift(told, found):
    """Narrower than the declared range is amber and says so; the end of the grid is no limit."""
    assert top(told, found).kind == "good"
    for shift in ([45.0, 70.0], [29.9, 50.0]):
        wide = top(declare(told, shift), found)
        assert wide.kind == "unsure" and "declares your own" not in wide.caveat
        assert wide.caveat.startswith(
            f"In a shift, temperature moves from {shift[0]:.2g} to {shift[1]:.2g} °C."
        )
        assert "stands less than that." in wide.caveat and "wearscope track DATA" in wide.action
    assumed = top(declare(told, None), found)
    assert "shift of the factor declares your own" in assumed.caveat.striptags() and assumed.kind == "unsure"
    assert "30 to 70 °C" in assumed.caveat
    assert reach_of_shifts(declare(told, [45.0, 62.0])) == {"w3": 12.0, "w5": 10.0}


def test_a_better_detector_that_is_withheld_is_told_on_top(told, found):
    """The second best is recommended then: the strip is unsure, and says whose SNR is larger."""
    medians = [("", "C", 2.0), ("", "A", 3.0), ("", "B", 1.0), ("large", "B", 9.0)]
    ranked = replace(told, rankings=pd.DataFrame(medians, columns=["robot", "fda", "median"]))
    assert top(ranked, replace(found, withheld=["A"])).kind == "unsure"
    assert top(ranked, replace(found, withheld=["A", "B"])).caveat == (
        "Residual energy (A) has a larger signal-to-noise ratio and is withheld: direct simulation "
        "contradicts its surrogate."
    )
    fine = top(ranked, replace(found, withheld=["B"]))
    assert fine.kind == "good" and "withheld" not in fine.caveat
    bound = top(ranked, replace(found, withheld=["A"], upper=["A"]))
    assert bound.kind == "good" and "withheld" not in bound.caveat


def test_what_holds_for_every_robot_is_said_once(told, found):
    """Resamplings are told by robot, rates again only where they are not those of the first."""
    large, medium = replace(found, robot="large"), replace(found, robot="medium", detector="A", agree=13)
    sure = top(told, found, large, medium).sure
    assert sure.count("The same detector comes out in") == 2 and "On medium: The same" in sure
    assert sure.count("At most 1 % false alarms") == 1
    other = top(told, found, large, replace(medium, cells_sure=5)).sure
    assert other.endswith(
        "in 5 of 8 combinations of robot, test-cycle and axis, with 95 % confidence in the surrogates."
    )
    assert "On medium: At most 1 % false alarms" in other


def test_nothing_found_and_nothing_recommended_are_answers(told, found):
    blind = replace(found, wear=np.nan, bounds=[])
    assert "no change of wear that was simulated is surely found" in top(told, blind).answer
    assert top(told, blind).kind == "bad"
    none = replace(blind, detector="", withheld=["A", "C"])
    assert top(told, none).answer == (
        "No detector can be recommended: "
        "the answers of Residual energy (A) and Friction fit (C) are withheld."
    )
    assert "none sees wear" in top(told, replace(none, withheld=[])).answer


def test_there_is_one_recommendation_a_robot_and_no_other_on_top(told, found):
    """Where robots differ the one of all together is not told; where they agree, it alone is."""
    medium, large = replace(found, robot="medium"), replace(found, robot="large", detector="A", wear=30.0)
    differing = top(told, found, medium, large)
    assert differing.answer.startswith("On medium: Use Friction fit (C). It finds wear of 20")
    assert "On large: Use Residual energy (A). It finds wear of 30" in differing.answer
    assert differing.answer.count("Use ") == 2
    alike = top(told, found, medium, replace(large, detector="C"))
    assert alike.answer.count("Use ") == 1 and "On " not in alike.answer
    assert list(thresholds_of(told, replace(found, robot="large"))["threshold"]) == [9]
    lost = top(told, found, medium, replace(large, detector="", wear=np.nan))
    assert lost.kind == "bad" and "On large: No detector can be recommended" in lost.answer


def test_wear_is_told_as_friction(told, found):
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
    assert "It finds 8 to 20 % more friction (wear of 20) or more" in top(study, found).answer
    assert friction_rise(told, 20.0) is None


def test_thresholds_of_a_robot_whose_numbers_are_assumed_are_not_offered(told, found):
    guessed = top(replace(told, sources={"medium": ["friction assumed"]}), found)
    assert "wearscope diagnose DATA" in guessed.action and "thresholds" not in guessed.action
    given = top(replace(told, sources={"medium": ["paper"]}), found)
    assert "alarm thresholds" in given.action.striptags()


def test_an_upper_bound_is_told_and_not_recommended(told, found):
    bound = replace(found, upper=["A"])
    asked = replace(told, conclusions=[bound])
    assert "Residual energy (A) is told the friction law" in " ".join(qualify(asked))
    alone = replace(found, detector="", wear=np.nan, bounds=[], upper=["A", "C"])
    assert top(told, alone).answer == (
        "No detector can be recommended: apart from Residual energy (A) and Friction fit (C), which are "
        "told the simulator's law, none sees wear."
    )


def test_the_page_begins_with_it(asked):
    page = render_study(asked, compare_with_paper(asked))
    top = page[page.index("<header>") : page.index("<main")]
    assert re.search('class="answer">(On [a-z]+: )?(Use|No detector)', top)
    for heading in ("How sure", "Mind", "Next"):
        assert f"<dt>{heading}</dt>" in top
    assert 'id="thresholds"' in page and 'id="reach"' in top


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
