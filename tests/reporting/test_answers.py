import numpy as np
import pytest

from wearscope.evaluation.ranking import rank_by_median
from wearscope.evaluation.sensitivity import sensitivity_of
from wearscope.reporting.answers import (
    best_detector,
    effective_scope,
    relevant_factors,
    tolerances,
)
from wearscope.reporting.trust import audit_outcome, doubts, surrogate_quality


def sensitivity(study, term, size):
    """The sensitivity table with one term's direct coefficient of every cell set."""
    table = study.surrogates.copy()
    rows = (table["term"] == term) & table["theta_normalised"].notna()
    table.loc[rows, "theta_normalised"] = size
    return sensitivity_of([table])


def test_what_outweighs_wear_is_named_and_none_is_an_answer(study, change):
    loud = relevant_factors(change(sensitivity=sensitivity(study, "w4", -3.0)))
    assert loud[0].startswith("Residual energy (A): delay")
    assert loud[0].endswith("more than wear, in 100 % of the cells.")
    quiet = relevant_factors(change(sensitivity=sensitivity(study, "w4", 0.0)))
    assert quiet[0] == "Residual energy (A): none; no term outweighs wear in more than half of the 8 cells."
    assert "elay" in quiet[-1] and "hardly matter" in quiet[-1]
    assert "Delay" not in loud[-1] and "delay" not in loud[-1]


def test_an_unsettled_share_is_called_so(study, change):
    table = sensitivity(study, "w4", 3.0)
    rows = (table["term"] == "w4") & (table["fda"] == "A")
    table.loc[rows, ["n_relevant", "share_relevant", "share_low", "share_high"]] = 5, 0.625, 0.3, 0.86
    said = relevant_factors(change(sensitivity=table))[0]
    assert said.startswith("Residual energy (A): ") and "delay" in said
    assert said.endswith("Few cells were asked: it may be less than half.")


def test_a_square_is_named_only_where_the_full_model_agrees(study, change):
    table = sensitivity(study, "w4^2", 3.0)
    surrogates = study.surrogates.copy()
    square = (surrogates["term"] == "w4^2") & (surrogates["model"] == "full")
    surrogates.loc[square, "theta_normalised"] = 0.01
    assert "delay²" not in relevant_factors(change(sensitivity=table, surrogates=surrogates))[0]
    surrogates.loc[square, "theta_normalised"] = 3.0
    both = relevant_factors(change(sensitivity=table, surrogates=surrogates))
    assert "delay²" in both[0] and "elay" not in both[-1]


def test_a_detector_without_any_effect_of_wear_is_unknown(study, change):
    table = study.surrogates.copy()
    table.loc[table["fda"] == "B", "theta_normalised"] = np.nan
    said = relevant_factors(change(sensitivity=sensitivity_of([table])))
    assert (
        said[1]
        == "Distribution distance (B): unknown, wear has no direct effect on the test quantity in any cell."
    )


def ranked(study, levels, spread=0.01):
    snr = study.snr.copy()
    snr["snr_exact"] = snr["fda"].map(levels) + spread * np.sin(np.arange(len(snr)) * 7.0)
    return rank_by_median(snr, draws=200)


def test_the_best_detector_follows_the_ranking(study, change):
    clear = best_detector(change(ranking=ranked(study, {"A": 1.0, "B": 9.0, "C": 3.0})))
    assert clear[0].startswith("Distribution distance (B) has the highest") and "first in 95 %" in clear[1]
    tied = best_detector(change(ranking=ranked(study, {"A": 3.0, "B": 1.0, "C": 3.0}, spread=5.0)))
    assert tied[1].startswith("The choice of cells leaves open whether it beats")
    useless = best_detector(change(ranking=ranked(study, {"A": -1.0, "B": -9.0, "C": -3.0})))
    assert "no detector sees the change" in useless[1]


def test_odd_cells_are_counted(study):
    said = best_detector(study)
    assert "In 1 cell the test quantity falls with wear; their sign is not reversed." in said
    assert "In 1 cell the test quantity is always the same; they have no SNR." in said


def test_no_snr_at_all_is_unknown(study, change):
    snr = study.snr.assign(snr_exact=np.nan)
    assert best_detector(change(ranking=rank_by_median(snr, draws=50))) == [
        "Unknown: no group has a median SNR."
    ]


def with_limit(study, limit):
    """Scope in which a cell passes up to a sigma that grows with the change of wear."""
    scope = study.scope.copy()
    scope["passes"] = scope["sigma"] <= limit * scope["delta"]
    return scope


def test_tolerances_are_read_off_the_grid(study, change):
    found = tolerances(change(scope=with_limit(study, 0.2)), "w3")
    mine = [one for one in found if one.group == "Residual energy (A)"]
    assert [one.sigma for one in mine] == pytest.approx([0.7]) and not mine[0].largest
    assert mine[0].delta == study.scope["delta"].max()
    rows = with_limit(study, 0.2).query("fda == 'A' and factor == 'w3' and method == 'exact'")
    assert mine[0].share == rows["passes"].mean()


def test_the_end_of_the_scope_and_nothing_reached(study, change):
    low = tolerances(change(scope=with_limit(study, 0.02)), "w3")
    assert np.isnan(next(one for one in low if one.group == "Residual energy (A)").sigma)
    wide = tolerances(change(scope=with_limit(study, 1.0)), "w5")
    last = [one for one in wide if one.group == "Residual energy (A)"][-1]
    assert last.largest and last.sigma == study.scope["sigma"].max()
    nothing = effective_scope(change(scope=study.scope.assign(passes=False)))
    assert nothing[0].startswith("With varying temperature: none;") and len(nothing) == 2


def test_scope_sentences_rank_the_detectors(study, change):
    scope = study.scope.copy()
    scope["passes"] = (scope["fda"] == "B") | ((scope["fda"] == "A") & (scope["delta"] > 2))
    said = effective_scope(change(scope=scope))
    assert "Distribution distance (B) 100 %, Residual energy (A) 40 % and Friction fit (C) 0 %" in said[0]
    assert said[2] == (
        "With a change of wear of 50, half the cells of Distribution distance (B) tolerate a temperature "
        "with σ up to 10 °C, the end of the grid."
    )


def test_a_best_detector_that_reaches_nothing_says_so(study, change):
    scope = study.scope.copy()
    scope["passes"] = (scope["fda"] == "B") & (scope["robot"] == "large") & (scope["axis"] == 1)
    assert effective_scope(change(scope=scope))[2].startswith(
        "Even Distribution distance (B), with a change of wear of 50, does not"
    )


def test_audit_counts_what_was_held_and_leaves_failed_out(study, change):
    audit = study.audit
    good = audit[~audit["failed"]]
    said = audit_outcome(study)
    assert f"{int(good['inside'].sum())} of {len(good)} values" in said[0]
    assert len(good) == len(audit) - 1 and "Failed and left out: 1 audited value." in said
    verdicts = study.audit_verdicts
    assert said[-1].startswith(f"{int(verdicts['agrees'].sum())} of {len(verdicts)} scope verdicts")
    assert audit_outcome(change(audit=None))[0].startswith("Not audited")
    assert audit_outcome(change(audit_verdicts=verdicts.iloc[:0]))[-1].startswith("No scope verdict")


def test_poor_fits_are_counted(study, change):
    validation = study.validation.copy()
    full = validation.index[validation["model"] == "full"]
    validation.loc[full, "fit"] = 90.0
    validation.loc[full[:3], "fit"] = [10.0, -20.0, np.nan]
    said = surrogate_quality(change(validation=validation))
    assert "Residual energy (A) 90 %, Distribution distance (B) 90 %, Friction fit (C) 90 %; −20 %" in said
    assert "at worst, below 50 % in 2 of 23 cells; 1 cell n/a" in said
    gone = change(validation=validation.assign(fit=np.nan))
    assert "no fit" in surrogate_quality(gone)


def test_surrogates_that_do_not_hold_are_doubted(study, change):
    sound = change(validation=study.validation.assign(fit=90.0), audit=study.audit.assign(inside=True))
    assert doubts(sound) == []
    validation = sound.validation.copy()
    validation.loc[validation["fda"] == "B", "fit"] = 20.0
    said = doubts(change(validation=validation, audit=sound.audit))
    assert (
        len(said) == 1
        and "scope of Distribution distance (B): its full model fits the validation runs to 20 %" in said[0]
    )
    audit = study.audit.assign(inside=study.audit["fda"] != "C")
    said = doubts(change(validation=sound.validation, audit=audit))
    assert len(said) == 1 and "scope of Friction fit (C): the audit held 0 of" in said[0]


def test_answers_for_other_groups(study, change):
    by = ["robot", "axis"]
    config = dict(study.config, scope={**study.config["scope"], "group_by": by})
    other = change(
        config=config,
        sensitivity=sensitivity_of([study.surrogates], by=by),
        ranking=rank_by_median(study.snr, by=by, draws=50),
    )
    assert relevant_factors(other)[0].startswith("large, axis 1: ")
    assert ", axis " in best_detector(other)[0] and "large, axis 1" in effective_scope(other)[0]
