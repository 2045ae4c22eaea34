"""The conclusion of a study in one plain sentence, only as certain as its intervals allow."""

import numpy as np
import pandas as pd

from wearscope.evaluation.conclusion import Bound, Conclusion
from wearscope.reporting.labels import count_text, factor_name, join_words, quantity_text, unit_text
from wearscope.reporting.study import Study


def conclude(study: Study, one: Conclusion) -> str:
    """What to use, what it finds, while what, with which threshold."""
    where = f"On {one.robot}: " if one.robot else ""
    if not one.detector:
        why = f"the answers of {join_words(one.withheld)} are withheld" if one.withheld else "none sees wear"
        return f"{where}No detector can be recommended: {why}."
    if np.isnan(one.wear):
        return (
            f"{where}{one.detector} sees wear best, but no change of wear that was asked is "
            f"{'surely ' if one.shown_sure else ''}found: not in half of its "
            f"{count_text(one.cells, 'cell')}, even at the smallest variation of the other factors."
        )
    fault = study.factor("f")
    sure = "" if one.shown_sure else "by the estimates alone, "
    many = "" if one.cells_sure == one.cells else f" in {one.cells_sure} of {one.cells} cells"
    text = (
        f"{where}Use {one.detector}{_tie(one)}: {sure}it finds a change of {factor_name(fault)} of "
        f"{quantity_text(one.wear, fault.unit)} or more{many} {_while(study, one)}"
    )
    return f"{text}{_threshold(study, one)}."


def qualify(study: Study, one: Conclusion) -> list[str]:
    """How sure the conclusion is, and what it leaves open."""
    if not one.detector:
        return []
    said = []
    if one.tied_with:
        names = join_words([one.detector, *one.tied_with])
        said.append(
            f"The signal-to-noise ratios of {names} are not told apart at 95 %; of them {one.detector} is "
            "sure on the largest part of what was asked."
        )
    if not np.isnan(one.wear):
        said.append(
            f"Found: at most {100 * one.p_f:g} % false alarms and at least {100 * one.p_d:g} % detection"
            + (
                ", with 95 % confidence in the surrogates."
                if one.shown_sure
                else ", the surrogates' uncertainty not counted."
            )
            + " One factor varies at a time, normally distributed; the ranges hold 95 % of it."
        )
    if one.withheld:
        said.append(f"Withheld, as direct simulation contradicts them: {join_words(one.withheld)}.")
    elif study.audit is None:
        said.append("No direct simulation was asked to check it.")
    return said


def certainty(one: Conclusion) -> str:
    """Colour of the conclusion: good, unsure or bad."""
    if not one.detector or np.isnan(one.wear):
        return "bad"
    sure = one.shown_sure and one.cells_sure == one.cells and not one.tied_with
    return "good" if sure else "unsure"


def _tie(one: Conclusion) -> str:
    """The detectors that it is not told apart from, in brackets."""
    return f" (SNR not told apart from {join_words(one.tied_with, 'or')})" if one.tied_with else ""


def _while(study: Study, one: Conclusion) -> str:
    parts = [_bound(study, bound) for bound in one.bounds]
    return f"while {join_words(parts, 'or')}" if parts else ""


def _bound(study: Study, bound: Bound) -> str:
    factor = study.factor(bound.factor)
    most = "at least " if bound.largest else ""
    size = quantity_text(1.96 * bound.sigma, factor.unit)
    return f"{factor_name(factor)} stays within {most}±{size}"


def thresholds_of(study: Study, one: Conclusion) -> pd.DataFrame:
    """Thresholds that belong to a conclusion, a row a cell."""
    if study.thresholds is None or study.thresholds.empty:
        return pd.DataFrame(columns=["robot", "cycle", "axis", "fda", "threshold", "asked"])
    return study.thresholds[study.thresholds["asked"] == one.robot]


def _threshold(study: Study, one: Conclusion) -> str:
    values = thresholds_of(study, one)["threshold"].dropna()
    if values.empty:
        return ""
    unit = unit_text(study.units.get(one.detector, ""))
    low, high = (quantity_text(float(v), "") for v in (values.min(), values.max()))
    shown = low if low == high else f"{low} to {high}"
    by = "" if len(values) == 1 else " by cell"
    return f"; alarm threshold {f'{shown} {unit}'.strip()}{by}"
