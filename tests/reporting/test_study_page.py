from dataclasses import replace

import pandas as pd
import pytest

from wearscope.evaluation.sensitivity import sensitivity_of
from wearscope.reporting.findings import compare_with_paper
from wearscope.reporting.study_page import render_study


def render(study):
    return render_study(study, compare_with_paper(study))


VERDICT = {
    "verdict": [],
    "joints": {
        "a<1>": {
            "unit": "N m", "rms_before": 2.0, "rms_after": None, "noise_floor": None, "state": "explained",
        }
    },
}  # fmt: skip


@pytest.fixture
def with_loop(change):
    return change(loops={"twin": VERDICT}, planted={"planted": []})


def test_the_page_answers(with_loop):
    page = render(with_loop)
    for question in ("Which factors matter?", "Which detector is best?", "Where does it work?"):
        assert page.count(question) >= 3


def test_the_loop_is_on_the_first_page_and_missing_numbers_are_said(with_loop):
    page = render(with_loop)
    first = page[: page.index('<section id="paper"')]
    assert "The declared model suffices" in first and "and nothing was named" in first
    named = {**VERDICT, "joints": {"a<1>": {**VERDICT["joints"]["a<1>"], "state": "unexplained"}}}
    page = render(replace(with_loop, loops={"twin": named}))
    assert "a&lt;1&gt; keeps something unexplained" in page and "a<1>" not in page


def test_failed_points_are_counted_first_and_shown_in_full(study, change):
    page = render(study)
    first = page[: page.index('<section id="paper"')]
    assert (
        "1 test quantity failed: left out" in first and "ZeroDivision" not in first[: first.index('id="q1"')]
    )
    assert page.count("division by &lt;zero&gt;") == 1
    clean = render(change(failures=study.failures.iloc[:0]))
    assert "test quantity failed" not in clean and "of which the detector failed" not in clean


def test_failed_simulations_are_shown_first_and_in_full(study, change):
    failed = pd.DataFrame(
        [("medium", "a", "validation", 3, "joint 'x' is <lost>"), ("large", "b", "nominal", 2, "fell")],
        columns=["robot", "cycle", "set", "point", "reason"],
    )
    page = render(change(failed_simulations=failed))
    first = page[: page.index('<section id="paper"')]
    assert "2 simulations failed, the first at medium, a, validation point 3: joint" in first
    assert page.count("is &lt;lost&gt;") == 3 and "fell" in page
    assert "simulations failed" not in render(study)


def test_what_was_not_done_is_said(study, change):
    page = render(change(audit=None, audit_verdicts=None))
    assert "Not audited" in page
    for nothing in ("The closed loop", "not drawn", "no timings", "What it cost", "This study lacks"):
        assert nothing not in page


def test_assumptions_name_the_extrapolation_and_the_stand_ins(study, change):
    page = render(change(sources={"medium": ["Manutec r3; wear assumed", "wear assumed"]}))
    assert "s, and 0.467 at the centre" in page and "outside the design region" in page
    assert (
        "Residual energy (A), Distribution distance (B) and Friction fit (C) follow its description" in page
    )
    assert "Manutec r3; wear assumed<" in page


def test_every_verdict_of_the_comparison_is_a_badge(study):
    findings = compare_with_paper(study)
    page = render_study(study, findings)
    assert page.count('<span class="badge ') == len(findings)
    assert "&lt;span" not in page


def test_provenance(change):
    page = render(change(provenance={"commit": "abc123", "packages": {"numpy": "9.9"}}))
    assert "abc123" in page and "numpy 9.9" in page and "study: small" in page


def test_one_robot_one_cycle_one_axis(study, change):
    def part(table):
        return table[(table["robot"] == "large") & (table["cycle"] == "b") & (table["axis"] == 1)]

    single = change(
        **{
            name: part(getattr(study, name))
            for name in ("surrogates", "validation", "snr", "scope", "failures")
        },
        audit=None,
        audit_verdicts=None,
    )
    page = render(single)
    assert ">undecided</span>" not in page


def test_many_groups_keep_the_first_page_short(study, change):
    by = ["robot", "cycle", "axis", "fda"]
    page = render(change(sensitivity=sensitivity_of([study.surrogates], by=by)))
    first = page[: page.index('<section id="q1"')]
    cards = first[first.index('class="cards"') :]
    # A sentence stands once: in its card, or below in its section.
    assert cards.count("<li>") <= 8
    for detector in ("Residual energy (A)", "Friction fit (C)"):
        assert page.count(f"<li>large, a, axis 1, {detector}: ") == 1
    assert first.count("axis 2, Friction fit (C): ") < 4


def test_sources_that_say_nothing_leave_no_punctuation(change):
    study = change(sources={"medium": ["", "links given; friction assumed", "friction assumed; "]})
    page = render(study)
    assert "<dd>links given; friction assumed</dd>" in page
