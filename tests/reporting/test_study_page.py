import base64
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from wearscope.evaluation.sensitivity import sensitivity_of
from wearscope.reporting.costs import read_costs
from wearscope.reporting.figures.boxes import draw_snr
from wearscope.reporting.findings import compare_with_paper
from wearscope.reporting.study_page import render_study
from wearscope.reporting.style import save_figure


def render(study):
    return render_study(study, compare_with_paper(study))


VERDICT = {
    "verdict": [],
    "stopped": [],
    "joints": {
        "a<1>": {
            "unit": "N m", "rms_before": 2.0, "rms_after": None, "noise_floor": None, "state": "explained",
        }
    },
}  # fmt: skip


@pytest.fixture
def with_figure(study, change, tmp_path):
    path = tmp_path / "recording.svg"
    save_figure(draw_snr(study.snr, study.ranking), path)
    return change(figures={"recording": path}, loops={"twin": VERDICT}, planted={"planted": []})


def test_the_page_stands_alone_and_answers(with_figure, request):
    page = render(with_figure)
    written = page[: page.index('<script type="application/json" id="settings">')]
    assert written.count("<img ") == written.count('alt="') == 1 and 'alt=""' not in written
    for text in ("src=", "href="):
        for start in written.split(text)[1:]:
            assert start.startswith(('"data:', '"#', '"closed_loop/twin/report.html"'))
    assert "<script src" not in page and "@import" not in written
    for question in (
        "Which factors matter?",
        "Which detector is best?",
        "Where does it work?",
    ):
        assert page.count(question) >= 3
    assert base64.b64encode(with_figure.figures["recording"].read_bytes()).decode() in page


def test_the_loop_is_on_the_first_page_and_missing_numbers_are_said(with_figure):
    page = render(with_figure)
    first = page[: page.index('<section id="paper"')]
    assert "The declared model suffices" in first and "so it should be" in first
    named = {**VERDICT, "joints": {"a<1>": {**VERDICT["joints"]["a<1>"], "state": "unexplained"}}}
    page = render(replace(with_figure, loops={"twin": named}))
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
    page = render(change(audit=None, audit_summary=None, audit_verdicts=None))
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


def test_provenance_and_costs(study, change):
    costs = pd.DataFrame(
        [("simulate_points", 4, 612.3, 310.0)], columns=["stage", "jobs", "seconds", "memory"]
    )
    page = render(change(costs=costs, provenance={"commit": "abc123", "packages": {"numpy": "9.9"}}))
    assert "abc123" in page and "numpy 9.9" in page and "612" in page and "study: small" in page


def test_one_robot_one_cycle_one_axis(study, change):
    def part(table):
        return table[(table["robot"] == "large") & (table["cycle"] == "b") & (table["axis"] == 1)]

    single = change(
        **{
            name: part(getattr(study, name))
            for name in ("surrogates", "validation", "snr", "scope", "failures")
        },
        fits=study.fits[(study.fits["robot"] == "large") & (study.fits["cycle"] == "b")],
        audit=None,
        audit_summary=None,
        audit_verdicts=None,
    )
    page = render(single)
    assert "undecided" in page and "1 cell: too few for an interval." in page


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


def test_equal_studies_give_equal_pages(with_figure):
    assert render(with_figure) == render(with_figure)


def test_costs_are_added_up_by_rule(tmp_path):
    head = "s\th:m:s\tmax_rss\n"
    (tmp_path / "simulate_points" / "medium").mkdir(parents=True)
    (tmp_path / "simulate_points" / "medium" / "0.tsv").write_text(head + "1.5\t0:00:01\t100\n")
    (tmp_path / "simulate_points" / "medium" / "1.tsv").write_text(head + "2.5\t0:00:02\t300\n")
    (tmp_path / "compute_snr.tsv").write_text(head + "4\t0:00:04\t-\n")
    (tmp_path / "broken.tsv").write_text("nothing\n")
    costs = read_costs(tmp_path).set_index("stage")
    assert list(costs.index) == ["compute_snr", "simulate_points"]
    assert costs.loc["simulate_points"].to_list() == [2, 4.0, 300.0]
    assert np.isclose(costs.loc["compute_snr", "seconds"], 4.0)
    assert read_costs(tmp_path / "missing").empty


def test_sources_that_say_nothing_leave_no_punctuation(change):
    study = change(sources={"medium": ["", "links given; friction assumed", "friction assumed; "]})
    page = render(study)
    assert "<dd>links given; friction assumed</dd>" in page
