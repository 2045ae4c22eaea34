"""The conclusion of a study in plain sentences, only as certain as its intervals allow."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from wearscope.evaluation.conclusion import Bound, Conclusion
from wearscope.evaluation.recommendation import SETTLED
from wearscope.reporting import trust
from wearscope.reporting.labels import factor_name, join_words, quantity_text
from wearscope.reporting.page import say
from wearscope.reporting.page_strip import Strip
from wearscope.reporting.study import Study

if TYPE_CHECKING:
    from wearscope.designs.factors import Factor

#: Share of a joint's top speed at which a wear level is told as friction.
SPEED = 0.1
#: Caveat of a study whose answer nothing else limits more.
SIMULATED = "Everything is simulated; recordings of the robot say how well (wearscope diagnose)."
_WORDS = "study/strip.html"


def study_strip(study: Study, pages: bool = False) -> Strip | None:
    """Which detector to use, one recommendation a robot; None where the study did not come so far.

    Parameters
    ----------
    study : Study
    pages : bool
        Whether each robot has a page of its own, with its thresholds and with what limits the answer.
    """
    if not study.conclusions:
        return None
    shown = study.conclusions[:1] if pages else recommendations(study)
    told = [describe(study, one, pages) for one in shown]
    kinds = [certainty(study, one) for one in shown]
    answer = " ".join([*(say(_WORDS, "answer", one).striptags() for one in told), trust.tell_basis(study)])
    kind = next(one for one in ("bad", "unsure", "good") if one in kinds)
    caveat = "" if pages else _caveat(study, shown, told)
    return Strip(answer.strip(), kind, say(_WORDS, "sure", told), caveat, say(_WORDS, "action", told[0]))


def recommendations(study: Study) -> Sequence[Conclusion]:
    """Recommendations: one for all robots where each has the same detector, else one for each robot."""
    whole, *own = study.conclusions
    return own if any(one.detector != whole.detector for one in own) else [whole]


def describe(study: Study, one: Conclusion, pages: bool = False) -> SimpleNamespace:
    """Values of a recommendation that the strip's words need."""
    rise = friction_rise(study, one.wear, one.robot) if np.isfinite(one.wear) else None
    less = [study.factor(bound.factor) for bound in one.bounds if _is_narrow(study, bound)]
    shifts = [f"{factor_name(factor)} moves from {_span(*shift(study, factor), factor)}" for factor in less]
    undeclared = [factor for factor in less if not study.config["factors"][factor.name].get("shift")]
    return SimpleNamespace(
        robot=one.robot,
        where=f"On robot {one.robot}: " if one.robot else "",
        name=study.detector_name(one.detector) if one.detector else "",
        tied=study.join_detectors(one.tied_with, "or"),
        withheld=study.join_detectors(one.withheld),
        upper=study.join_detectors(one.upper),
        told="is told" if len(one.upper) == 1 else "are told",
        wear="" if np.isnan(one.wear) else quantity_text(one.wear, study.factor("f").unit),
        friction=" to ".join(dict.fromkeys(f"{100 * end:.2g}" for end in rise)) if rise else "",
        bounds=join_words([_bound_text(study, bound) for bound in one.bounds], "or"),
        shifts=join_words(shifts),
        assumed=bool(undeclared),
        guessed=bool(trust.assumed_robots(study)),
        known=one.shown_sure,
        sure=one.cells_sure,
        cells=one.cells,
        first=one.cells_first,
        agree=one.agree,
        resamplings=one.resamplings,
        false=f"{100 * one.p_f:g}",
        detected=f"{100 * one.p_d:g}",
        pages=pages,
    )


def shift(study: Study, factor: "Factor") -> tuple[float, float]:
    """Natural levels between which a factor moves in a shift: as declared, else the study's own range."""
    low, high = study.config["factors"][factor.name].get("shift") or (factor.low, factor.high)
    return float(low), float(high)


def reach_of_shifts(study: Study) -> dict[str, float]:
    """How far each factor of the scope moves from its nominal level in a shift, natural units."""
    factors = [study.factor(name) for name in study.config["scope"]["factors"]]
    middles = [float(one.to_natural(one.nominal_coded)) for one in factors]
    pairs = zip(factors, middles, strict=True)
    return {one.name: max(abs(end - middle) for end in shift(study, one)) for one, middle in pairs}


def _is_narrow(study: Study, bound: Bound) -> bool:
    """Whether a detector tolerates less of a factor than a shift brings; the grid's end is no limit."""
    return not bound.largest and 1.96 * bound.sigma < reach_of_shifts(study)[bound.factor]


def _bound_text(study: Study, bound: Bound) -> str:
    factor = study.factor(bound.factor)
    size = quantity_text(1.96 * bound.sigma, factor.unit)
    return f"{factor_name(factor)} by {'at least ' if bound.largest else ''}±{size}"


def _span(low: float, high: float, factor: "Factor") -> str:
    return f"{quantity_text(low, '')} to {quantity_text(high, factor.unit)}"


def _caveat(study: Study, shown: Sequence[Conclusion], told: Sequence[SimpleNamespace]) -> str:
    """What would change the answer most, the first that applies."""
    codes = [one.detector for one in shown if one.detector]
    known = [
        tell_withheld(study, shown[0]),
        *(say(_WORDS, "narrow", one) for one in told if one.shifts),
        *(text for text in trust.doubts(study) for one in told if one.name and f" of {one.name}:" in text),
        *(trust.contradicted(study, code) for code in codes),
        trust.tell_assumed(study, codes[0]) if codes else "",
    ]
    return next(filter(None, known), SIMULATED)


def tell_withheld(study: Study, one: Conclusion) -> str:
    """Sentence on a withheld detector that could be deployed and has a larger median SNR, or nothing."""
    if study.rankings is None or not one.detector:
        return ""
    own = study.rankings[study.rankings["robot"] == one.robot].set_index("fda")["median"]
    better = [
        name
        for name in one.withheld
        if name not in one.upper and own.get(name, 0.0) > own.get(one.detector, np.inf)
    ]
    return say(_WORDS, "better", study.join_detectors(better), len(better)).striptags()


def friction_rise(study: Study, wear: float, robot: str = "") -> tuple[float, float] | None:
    """Least and largest rise of friction over the wearing joints; None where the study does not say.

    At `SPEED` of each joint's top speed and the middle temperature, between the levels of
    ``friction.parquet``.
    """
    table = study.friction
    if table is None or table["wear"].nunique() < 2 or study.factor("f").kind not in ("", "wear"):
        return None
    warm = np.sort(table["temperature"].unique())
    table = table[table["temperature"] == warm[len(warm) // 2]]
    rises = []
    for _, rows in table[table["robot"].isin([robot] if robot else table["robot"])].groupby(
        ["robot", "joint"]
    ):
        speeds = rows["speed"].unique()
        near = speeds[np.argmin(np.abs(speeds - SPEED * speeds.max()))]
        own = rows[rows["speed"] == near].sort_values("wear")
        torque = own["torque"].to_numpy(dtype=float)
        rises.append(float(np.interp(wear, own["wear"], torque) / torque[0] - 1.0))
    return (min(rises), max(rises)) if rises else None


def qualify(study: Study) -> list[str]:
    """What the conclusion leaves open."""
    one = study.conclusions[0]
    told = describe(study, one)
    law = [*(trust.mismatch_outcome(study, one.upper) if one.upper else []), say(_WORDS, "bound", told)]
    checked = say(_WORDS, "checked", told, study.audit is not None)
    return list(filter(None, [say(_WORDS, "tied", told), say(_WORDS, "ranges", told), *law, checked]))


def certainty(study: Study, one: Conclusion) -> str:
    """Colour of a recommendation: good, unsure or bad."""
    if not one.detector or np.isnan(one.wear):
        return "bad"
    sure = one.shown_sure and one.cells_sure == one.cells and not one.tied_with
    settled = one.agree >= SETTLED or not one.resamplings
    wide = not any(_is_narrow(study, bound) for bound in one.bounds)
    return "good" if sure and settled and wide and not tell_withheld(study, one) else "unsure"


def thresholds_of(study: Study, one: Conclusion) -> pd.DataFrame:
    """Thresholds that belong to a conclusion, a row a cell."""
    if study.thresholds is None or study.thresholds.empty:
        return pd.DataFrame(columns=["robot", "cycle", "axis", "fda", "threshold", "asked"])
    return study.thresholds[study.thresholds["asked"] == one.robot]
