"""Q-1, Q-2 and Q-3 answered in words; what is said of each case stands in the ``.txt`` next to this file."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from wearscope.evaluation.ranking import rank_by_median
from wearscope.evaluation.sensitivity import sensitivity_of
from wearscope.reporting.findings import compare_with_paper
from wearscope.reporting.study_page import render_study
from wearscope.reporting.study_words import (
    audit_outcome,
    best_detector,
    direct_outcome,
    doubts,
    effective_scope,
    relevant_factors,
    surrogate_quality,
    tolerances,
)


def weigh(study, term, size):
    """The study with one term's direct coefficient of every cell set."""
    table = study.surrogates.copy()
    rows = (table["term"] == term) & table["theta_normalised"].notna()
    table.loc[rows, "theta_normalised"] = size
    return replace(study, sensitivity=sensitivity_of([table]))


def unsettle(study):
    """The delay outweighs wear in 5 of 8 cells of a detector, which may be less than half."""
    table = weigh(study, "w4", 3.0).sensitivity
    rows = (table["term"] == "w4") & (table["fda"] == "A")
    table.loc[rows, ["n_relevant", "share_relevant", "share_low", "share_high"]] = 5, 0.625, 0.3, 0.86
    return replace(study, sensitivity=table)


def square(study, size):
    """The simplified model has a large square of the delay, the full one a square of a size."""
    surrogates = study.surrogates.copy()
    rows = (surrogates["term"] == "w4^2") & (surrogates["model"] == "full")
    surrogates.loc[rows, "theta_normalised"] = size
    return replace(weigh(study, "w4^2", 3.0), surrogates=surrogates)


def blind(study):
    """Wear has no direct effect on a detector."""
    table = study.surrogates.copy()
    table.loc[table["fda"] == "B", "theta_normalised"] = np.nan
    return replace(study, sensitivity=sensitivity_of([table]))


def rank(study, levels, spread=0.01):
    snr = study.snr.copy()
    snr["snr_exact"] = snr["fda"].map(levels) + spread * np.sin(np.arange(len(snr)) * 7.0)
    return replace(study, ranking=rank_by_median(snr, draws=200))


def group(study, by):
    config = dict(study.config, scope={**study.config["scope"], "group_by": by})
    ranking, table = rank_by_median(study.snr, by=by, draws=50), sensitivity_of([study.surrogates], by=by)
    return replace(study, config=config, sensitivity=table, ranking=ranking)


def passing(study, rule):
    """The study with a scope in which rows pass by a rule."""
    return replace(study, scope=study.scope.assign(passes=rule))


def fit(study, size, *others, fda=None):
    """The study with fits [%] of its surrogates: of all, then of the first full ones or of a detector."""
    validation = study.validation.assign(fit=size)
    full = validation.index[validation["model"] == "full"][: len(others)]
    validation.loc[validation["fda"] == fda if fda else full, "fit"] = others[0] if fda else list(others)
    return replace(study, validation=validation)


def sound(study):
    return replace(fit(study, 90.0), audit=study.audit.assign(inside=True))


def choose(study):
    """The study with chosen surrogates: good ones, ones at the noise's ceiling, and too few points."""
    cells = study.snr[["robot", "cycle", "axis", "fda"]].drop_duplicates()
    fit = cells["fda"].map({"A": 97.0, "B": 91.0, "C": 88.0})
    state = cells["fda"].map({"A": "reached", "B": "at ceiling", "C": "short"})
    table = cells.assign(kind="gaussian_process", fit=fit, state=state, ceiling=99.0, n_points=155)
    config = study.config | {"scope": study.config["scope"] | {"model": "chosen"}}
    return replace(study, chosen=table, config=config)


def withhold(study, *names):
    """The study with chosen surrogates, and answers of all detectors but those that are withheld."""
    rows = [(name, "chosen", 0.5, "withheld" if name in names else "given") for name in "ABC"]
    table = pd.DataFrame(rows, columns=["fda", "model", "share_inside", "answer"])
    return replace(choose(study), audit_answers=table)


def best(study):
    return str(study.ranking["fda"].iloc[0])


def answer_all(study):
    return [*best_detector(study), *effective_scope(study), *doubts(study)]


def measure(study):
    """The study with chosen surrogates and direct values, of which one agrees."""
    direct = pd.DataFrame(
        {
            "robot": "medium", "cycle": "a", "axis": 1, "fda": ["A", "B"], "runs": 60, "n_failed": 0,
            "snr_direct": [2.0, 5.0], "direct_low": [1.5, 4.0], "direct_high": [2.5, 6.0],
            "snr_surrogate": [2.2, 9.0], "surrogate_low": [2.1, 8.0], "surrogate_high": [2.3, 10.0],
            "agrees": [True, False],
        }
    )  # fmt: skip
    return replace(choose(study), direct=direct)


CASES = {
    "the delay outweighs wear": (relevant_factors, lambda s: weigh(s, "w4", -3.0)),
    "the delay does nothing": (relevant_factors, lambda s: weigh(s, "w4", 0.0)),
    "the share of cells is unsettled": (relevant_factors, unsettle),
    "a square that the full model lacks": (relevant_factors, lambda s: square(s, 0.01)),
    "a square that both models have": (relevant_factors, lambda s: square(s, 3.0)),
    "wear has no direct effect": (relevant_factors, blind),
    "factors by robot and axis": (relevant_factors, lambda s: group(s, ["robot", "axis"])),
    "odd cells": (best_detector, lambda s: s),
    "a clear ranking": (best_detector, lambda s: rank(s, {"A": 1.0, "B": 9.0, "C": 3.0})),
    "a tie": (best_detector, lambda s: rank(s, {"A": 3.0, "B": 1.0, "C": 3.0}, spread=5.0)),
    "no detector sees the change": (best_detector, lambda s: rank(s, {"A": -1.0, "B": -9.0, "C": -3.0})),
    "no SNR at all": (best_detector, lambda s: rank(s, {})),
    "detectors by robot and axis": (best_detector, lambda s: group(s, ["robot", "axis"])),
    "no cell passes": (effective_scope, lambda s: passing(s, False)),
    "detectors differ in scope": (
        effective_scope,
        lambda s: passing(s, lambda t: (t["fda"] == "B") | ((t["fda"] == "A") & (t["delta"] > 2))),
    ),
    "the best detector reaches nothing": (
        effective_scope,
        lambda s: passing(s, lambda t: (t["fda"] == "B") & (t["robot"] == "large") & (t["axis"] == 1)),
    ),
    "scope by robot and axis": (effective_scope, lambda s: group(s, ["robot", "axis"])),
    "poor fits": (lambda s: [surrogate_quality(s)], lambda s: fit(s, 90.0, 10.0, -20.0, np.nan)),
    "no fits": (lambda s: [surrogate_quality(s)], lambda s: fit(s, np.nan)),
    "sound surrogates": (doubts, sound),
    "a detector's surrogates fit badly": (doubts, lambda s: fit(sound(s), 90.0, 20.0, fda="B")),
    "the audit contradicts a detector": (
        doubts, lambda s: replace(sound(s), audit=s.audit.assign(inside=s.audit["fda"] != "C")),
    ),
    "chosen surrogates": (lambda s: [surrogate_quality(s)], choose),
    "no answer is withheld": (answer_all, withhold),
    "the best detector's answer is withheld": (answer_all, lambda s: withhold(s, best(s))),
    "all answers are withheld": (answer_all, lambda s: withhold(s, "A", "B", "C")),
    "direct values": (direct_outcome, measure),
    "no direct values": (direct_outcome, choose),
    "each cell's own interval": (
        best_detector, lambda s: replace(s, ranking=s.ranking.assign(interval_from="each cell")),
    ),
    "no noise": (best_detector, lambda s: replace(s, snr=s.snr.assign(status="noise-free"))),
    "the audit": (audit_outcome, lambda s: s),
    "no audit": (audit_outcome, lambda s: replace(s, audit=None)),
    "no verdict of the audit": (
        audit_outcome, lambda s: replace(s, audit_verdicts=s.audit_verdicts.iloc[:0]),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_study_is_answered_in_words(case, study, says):
    answer, change = CASES[case]
    says(case, *answer(change(study)))


def with_limit(study, limit):
    """Scope in which a cell passes up to a sigma that grows with the change of wear."""
    return passing(study, lambda table: table["sigma"] <= limit * table["delta"])


def test_tolerances_are_read_off_the_grid(study):
    found = tolerances(with_limit(study, 0.2), "w3")
    mine = [one for one in found if one.group == "Residual energy (A)"]
    assert [one.sigma for one in mine] == pytest.approx([0.7]) and not mine[0].largest
    assert mine[0].delta == study.scope["delta"].max()
    rows = with_limit(study, 0.2).scope.query("fda == 'A' and factor == 'w3' and method == 'exact'")
    assert mine[0].share == rows["passes"].mean()


def test_the_end_of_the_scope_and_nothing_reached(study):
    low = tolerances(with_limit(study, 0.02), "w3")
    assert np.isnan(next(one for one in low if one.group == "Residual energy (A)").sigma)
    wide = tolerances(with_limit(study, 1.0), "w5")
    last = [one for one in wide if one.group == "Residual energy (A)"][-1]
    assert last.largest and last.sigma == study.scope["sigma"].max()


def test_audit_leaves_failed_values_out(study):
    good, verdicts = study.audit[~study.audit["failed"]], study.audit_verdicts
    said = audit_outcome(study)
    assert len(good) == len(study.audit) - 1 and f"{int(good['inside'].sum())} of {len(good)}" in said[0]
    assert said[-1].startswith(f"{int(verdicts['agrees'].sum())} of {len(verdicts)} scope verdicts")


def test_a_withheld_answer_is_given_nowhere(study):
    name, shut = study.detector_name(best(study)), withhold(study, best(study))
    assert not any(name in one for one in [*best_detector(shut), *effective_scope(shut)])
    groups = [{one.group for one in tolerances(each, "w3")} for each in (shut, withhold(study))]
    assert name not in groups[0] and name in groups[1]


def test_direct_values_stand_on_the_page_next_to_the_surrogate_s(study):
    page = render_study(measure(study), compare_with_paper(measure(study)))
    assert "2 (1.5 to 2.5)" in page and "2.2 (2.1 to 2.3)" in page
    assert "runs that no choice saw" in page and "8 gaussian process" in page
