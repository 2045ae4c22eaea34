import numpy as np
import pandas as pd
import pytest

from wearscope.evaluation.grouping import (
    Estimate,
    decide,
    estimate_columns,
    estimate_difference,
    nan_mean,
    nan_median,
)
from wearscope.reporting.findings import compare_with_paper, findings_table


def verdict_of(study, start):
    found = [one for one in compare_with_paper(study) if one.paper.startswith(start)]
    assert len(found) == 1
    return found[0].verdict


def wide(columns):
    frame = pd.DataFrame(columns, dtype=float)
    frame.index = pd.MultiIndex.from_tuples([("r", "c", k) for k in range(len(frame))])
    return frame


PAYLOAD, LESS = "Payload mass error moves A", "B and C respond less"


@pytest.mark.parametrize(
    ("term", "sizes", "finding", "verdict"),
    [
        ("w3", (3.0, 2.0, 0.8), "Temperature considerably", "agrees"),
        ("w3", (0.1, 0.2, 0.3), "Temperature considerably", "disagrees"),
        ("w3", (3.0, 2.0, 0.3), "Temperature considerably", "partly"),
        ("w3", (-3.0, 2.0, 0.8), "Temperature considerably", "agrees"),
        ("w3", (2.0, 3.0, 1.0), "C has the lowest", "agrees"),
        ("w3", (2.0, 3.0, 2.5), "C has the lowest", "partly"),
        *(("w5", (3.0, 0.5, 0.1), finding, "agrees") for finding in (PAYLOAD, LESS)),
        *(("w5", (0.2, 0.5, 0.9), finding, "disagrees") for finding in (PAYLOAD, LESS)),
    ],
)
def test_findings_of_coefficients_follow_the_numbers(change, set_term, term, sizes, finding, verdict):
    study = change(surrogates=set_term(term, dict(zip("ABC", sizes, strict=True))))
    assert verdict_of(study, finding) == verdict


def test_an_interval_across_the_threshold_is_undecided(study, change, set_term):
    table = set_term("w3", {"A": 2.0, "B": 2.0, "C": 2.0})
    rows = table.index[(table["fda"] == "B") & (table["term"] == "w3") & (table["model"] == "simplified")]
    table.loc[rows, "theta_normalised"] = np.where(np.arange(len(rows)) % 2, 0.1, 2.0)
    assert verdict_of(change(surrogates=table), "Temperature considerably") == "undecided"


@pytest.mark.parametrize(
    "levels, verdict, order",
    [
        ({"A": 1.0, "B": 2.0, "C": 3.0}, "agrees", "C > B > A"),
        ({"A": 3.0, "B": 2.0, "C": 1.0}, "disagrees", "A > B > C"),
        ({"A": 1.0, "B": 3.0, "C": 2.0}, "partly", "B > C > A"),
        ({"A": 2.0, "B": 2.0, "C": 2.0}, "undecided", ">"),
    ],
)
def test_ranking_finding_follows_the_snr(study, change, levels, verdict, order):
    snr = study.snr.copy()
    noise = 0.01 * np.sin(np.arange(len(snr)) * 7.0)
    snr["snr_exact"] = snr["fda"].map(levels) + noise
    found = [one for one in compare_with_paper(change(snr=snr)) if one.question == "Q-2"]
    assert [one.verdict for one in found] == [verdict]
    assert order in found[0].here


def test_scope_findings_follow_the_scope(study, change):
    scope = study.scope.copy()
    limit = {"A": 1.0, "B": 3.0, "C": 1.0}
    scope["passes"] = scope["delta"] >= scope["fda"].map(limit)
    changed = change(scope=scope)
    assert verdict_of(changed, "A and C allow more") == "agrees"
    assert verdict_of(changed, "C is the least affected") == "undecided"
    found = {one.paper: one for one in compare_with_paper(changed)}
    assert "C less A 0 points" in found["C is the least affected by payload disturbances."].here
    scope["passes"] = scope["delta"] >= scope["fda"].map({"A": 3.0, "B": 1.0, "C": 3.0})
    assert verdict_of(change(scope=scope), "A and C allow more") == "disagrees"


def test_fit_findings_follow_the_validation(study, change):
    validation = study.validation.copy()
    validation["fit"] = np.where(validation["model"] == "full", 90.0, 70.0)
    good = change(validation=validation)
    assert verdict_of(good, "The full model fits") == "agrees"
    assert verdict_of(good, "The simplified model fits") == "agrees"
    validation = validation.assign(fit=20.0)
    assert verdict_of(change(validation=validation), "The full model fits") == "disagrees"
    validation.loc[(validation["model"] == "full") & (validation["fda"] == "B"), "fit"] = 90.0
    assert verdict_of(change(validation=validation), "The full model gains most") == "agrees"


def test_missing_fits_are_counted(study):
    here = next(one.here for one in compare_with_paper(study) if one.paper.startswith("The full model fits"))
    assert "1 cell n/a" in here


def test_of_few_cells_nothing_is_asked(study, change):
    one = (study.surrogates["robot"] == "medium") & (study.surrogates["cycle"] == "b")
    few = change(surrogates=study.surrogates[one])
    assert verdict_of(few, "Temperature considerably") == "not asked"
    text = next(one.here for one in compare_with_paper(few) if one.paper.startswith("Temperature"))
    assert text == "This study has too few cells for an interval."


def test_a_study_without_the_stand_ins_is_not_asked(study, change):
    config = dict(study.config, detectors={"mine": {"use": "my.py", "options": {}}})
    found = compare_with_paper(change(config=config))
    assert {one.verdict for one in found} == {"not asked"}
    bare = change(factors=study.factors[:1])
    assert verdict_of(bare, "Temperature considerably") == "not asked"


def test_stand_ins_are_found_by_module_not_by_name(study, change):
    config = dict(study.config)
    config["detectors"] = {"A": {"use": "friction_fit"}, "B": {"use": "wasserstein"}}
    found = compare_with_paper(change(config=config))
    assert next(one for one in found if one.question == "Q-2").verdict == "not asked"


def test_findings_are_a_table(study):
    table = findings_table(compare_with_paper(study))
    assert list(table.columns) == ["question", "paper", "here", "verdict"]
    assert len(table) == 11 and (table["here"].str.len() > 10).all()


def test_paired_differences_see_what_medians_hide():
    rng = np.random.default_rng(0)
    level = rng.normal(0, 10, 30)
    frame = wide({"A": level, "B": level + 1.0 + 0.1 * rng.normal(size=30)})
    apart = estimate_columns(frame, nan_mean)
    assert apart["B"].low < apart["A"].high
    assert estimate_difference(frame, "B", "A", nan_mean).above(0) is True
    assert estimate_difference(frame, "A", "B", nan_mean).above(0) is False


def test_nan_is_left_out_and_counted():
    frame = wide({"A": [1, 2, 3, 4, 5, np.nan, 7], "B": [np.nan] * 7})
    found = estimate_columns(frame)
    assert found["A"].value == 3.5 and found["A"].n == 6
    assert np.isnan(found["B"].value) and found["B"].n == 0 and found["B"].above(0) is None
    assert estimate_difference(frame, "A", "B").n == 0


def test_statistics_leave_nan_out_as_numpy_does():
    values = np.random.default_rng(1).normal(size=(4, 9, 3))
    values[0, :4, 1] = np.nan
    values[1, :5, 2] = np.nan
    assert np.array_equal(nan_median(values), np.nanmedian(values, axis=-2))
    assert nan_mean(values) == pytest.approx(np.nanmean(values, axis=-2))
    values[2, :, 0] = np.nan
    assert np.isnan(nan_median(values)[2, 0]) and np.isnan(nan_mean(values)[2, 0])


def test_an_estimate_is_decided_by_its_whole_interval():
    assert Estimate(2, 1, 3, 9).above(0.5) is True
    assert Estimate(2, 1, 3, 9).above(1.5) is None
    assert Estimate(2, 1, 3, 9).below(4) is True
    assert Estimate(2, np.nan, np.nan, 3).above(0) is None


@pytest.mark.parametrize(
    "parts, outcome",
    [
        ([], "not asked"), ([True, True], "agrees"), ([False, None], "disagrees"),
        ([True, None], "undecided"), ([True, False], "partly"), ([None], "undecided"),
    ],
)  # fmt: skip
def test_parts_make_a_verdict(parts, outcome):
    assert decide(parts) == outcome
