"""The conclusion of a study in words; what is said of each case stands in the ``.txt`` next to this file."""

import re
import shlex
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import yaml

from wearscope.config import load_config
from wearscope.evaluation.conclusion import Bound, Conclusion
from wearscope.reporting.findings import compare_with_paper
from wearscope.reporting.study_page import render_study
from wearscope.reporting.study_words import (
    ask_moved,
    certainty,
    friction_rise,
    qualify,
    reach_of_shifts,
    study_strip,
    thresholds_of,
)  # fmt: skip

#: Bears 19.6 degrees of the 20 that the study varies, and 9.8 % of payload, where the grid ends.
FOUND = Conclusion(
    "", "C", [], [], 20.0, [Bound("w3", 10.0, False), Bound("w5", 5.0, True)], 8, 8, True, 0.01, 0.99, [], 19,
    20, 7,
)  # fmt: skip
LARGE, MEDIUM = replace(FOUND, robot="large"), replace(FOUND, robot="medium")
BLIND = replace(FOUND, wear=np.nan, bounds=[])
NONE = replace(BLIND, detector="")
MEDIANS = pd.DataFrame(
    [("", "C", 2.0), ("", "A", 3.0), ("", "B", 1.0), ("large", "B", 9.0)], columns=["robot", "fda", "median"]
)
FRICTION = pd.DataFrame(
    [
        ("medium", joint, speed, 50.0, wear, torque * (1 + rise * wear / 50))
        for joint, torque, rise in (("a", 10.0, 0.2), ("b", 40.0, 0.5))
        for speed in (0.1, 0.5, 1.0)
        for wear in (0.0, 25.0, 50.0)
    ],
    columns=["robot", "joint", "speed", "temperature", "wear", "torque"],
)
ASSUMED = {"sources": {"arm": ["URDF given; friction assumed"]}}
DIRECT = pd.DataFrame(
    {"robot": "medium", "cycle": "a", "axis": 1, "fda": ["C"], "snr_direct": [42.0], "direct_low": [40.0],
     "direct_high": [45.0], "snr_surrogate": [32.0], "agrees": [False], "surrogate_low": [30.0],
     "surrogate_high": [34.0], "runs": [60]}
)  # fmt: skip
#: Conclusions, the declared shift of the temperature, and other fields of the study.
CASES = {
    "a detector is found": ([FOUND], [40.0, 60.0], {}),
    "another is not told apart": ([replace(FOUND, tied_with=["A"])], [40.0, 60.0], {}),
    "not all cells are sure": ([replace(FOUND, cells_sure=5)], [40.0, 60.0], {}),
    "estimates alone": ([replace(FOUND, shown_sure=False)], [40.0, 60.0], {}),
    "a shift is wider": ([FOUND], [45.0, 70.0], {}),
    "a shift is wider below": ([FOUND], [29.9, 50.0], {}),
    "no shift is declared": ([FOUND], None, {}),
    "a better detector is withheld": (
        [replace(FOUND, withheld=["A", "B"])], [40.0, 60.0], {"rankings": MEDIANS},
    ),
    "a worse detector is withheld": ([replace(FOUND, withheld=["B"])], [40.0, 60.0], {"rankings": MEDIANS}),
    "an upper bound is withheld": (
        [replace(FOUND, withheld=["A"], upper=["A"])], [40.0, 60.0], {"rankings": MEDIANS},
    ),
    "robots differ": (
        [FOUND, LARGE, replace(MEDIUM, detector="A", agree=13, wear=30.0)], [40.0, 60.0], {},
    ),
    "robots differ also in sure cells": (
        [FOUND, LARGE, replace(MEDIUM, detector="A", agree=13, cells_sure=5)], [40.0, 60.0], {},
    ),
    "robots agree": ([FOUND, MEDIUM, LARGE], [40.0, 60.0], {}),
    "a robot has no detector": (
        [FOUND, MEDIUM, replace(LARGE, detector="", wear=np.nan)], [40.0, 60.0], {},
    ),
    "no wear is found": ([BLIND], [40.0, 60.0], {}),
    "all are withheld": ([replace(NONE, withheld=["A", "C"])], [40.0, 60.0], {}),
    "none sees wear": ([NONE], [40.0, 60.0], {}),
    "none but upper bounds sees wear": ([replace(NONE, upper=["A", "C"])], [40.0, 60.0], {}),
    "an upper bound": ([replace(FOUND, upper=["A"])], [40.0, 60.0], {}),
    "wear as friction": ([FOUND], [40.0, 60.0], {"friction": FRICTION}),
    "numbers are assumed": ([FOUND], [40.0, 60.0], ASSUMED),
    "numbers of one robot are assumed": (
        [FOUND], [40.0, 60.0], {"sources": {"arm": ["assumed"], "medium": ["paper"]}},
    ),
    "numbers are given": ([FOUND], [40.0, 60.0], {"sources": {"medium": ["paper"]}}),
    "a direct value disagrees": ([FOUND], [40.0, 60.0], {"direct": DIRECT}),
    "a direct value agrees": ([FOUND], [40.0, 60.0], {"direct": DIRECT.assign(agrees=True)}),
}  # fmt: skip


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
    return declare(replace(study, thresholds=thresholds, units={"C": "N m"}, audit=None), [40.0, 60.0])


def declare(study, shift):
    """The study with a declared shift of its temperature."""
    factors = study.config["factors"]
    factors = factors | {"w3": factors["w3"] | {"shift": shift}}
    return replace(study, config=study.config | {"factors": factors})


@pytest.mark.parametrize("case", CASES)
def test_a_study_is_concluded_no_surer_than_its_parts(case, told, says):
    conclusions, shift, fields = CASES[case]
    study = declare(replace(told, conclusions=conclusions, **fields), shift)
    strip = study_strip(study)
    says(case, strip.kind, strip.answer, strip.sure, strip.caveat, strip.action, *qualify(study))


def test_resamplings_settle_a_recommendation(told):
    assert [certainty(told, replace(FOUND, agree=agree)) for agree in (18, 17)] == ["good", "unsure"]


def test_a_shift_moves_a_factor_to_its_further_end(told):
    assert reach_of_shifts(declare(told, [45.0, 62.0])) == {"w3": 12.0, "w5": 10.0}


def test_thresholds_are_those_of_the_conclusion_s_robot(told):
    assert list(thresholds_of(told, LARGE)["threshold"]) == [9]


def test_wear_is_told_as_friction(told):
    assert friction_rise(replace(told, friction=FRICTION), 20.0) == pytest.approx((0.08, 0.2))
    assert friction_rise(told, 20.0) is None


def test_the_page_begins_with_it(asked):
    page = render_study(asked, compare_with_paper(asked))
    top = page[page.index("<header>") : page.index("<main")]
    assert re.search('class="answer">(On robot [a-z]+: )?([Uu]se|[Nn]o detector)', top)
    for heading in ("How sure", "Mind", "Next"):
        assert f"<dt>{heading}</dt>" in top
    assert 'id="thresholds"' in page and 'id="reach"' in top


def test_what_is_assumed_and_how_far_the_answer_moves_are_on_the_headline(told):
    study = replace(told, conclusions=[FOUND], audit_answers=None, **ASSUMED)
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
    assert not ask_moved(replace(study, sources={"arm": ["paper"]}))


def test_a_direct_value_that_disagrees_is_the_answer(told):
    study = replace(told, conclusions=[FOUND], direct=DIRECT)
    assert "the direct value is the answer" in render_study(study, compare_with_paper(study))
