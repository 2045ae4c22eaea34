"""The conclusion of a study in plain sentences, only as certain as its intervals allow."""

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.evaluation.conclusion import Conclusion
from wearscope.reporting import trust
from wearscope.reporting.labels import count_text, factor_name, join_words, quantity_text
from wearscope.reporting.page_strip import Strip
from wearscope.reporting.study import Study

#: Share of a joint's top speed at which a wear level is told as friction.
SPEED = 0.1
#: What a combination is that has a verdict of the detector to use.
_CELLS = "of robot, test-cycle and axis"
#: Where nothing else limits a study's answer more.
SIMULATED = "Everything is simulated; recordings of the robot say how well (wearscope diagnose)."


def study_strip(study: Study, pages: bool = False) -> Strip | None:
    """Which detector to use; None where the study did not come so far.

    Parameters
    ----------
    study : Study
    pages : bool
        Whether each robot has a page of its own, with its thresholds and with what limits the answer.
    """
    if not study.conclusions:
        return None
    one = study.conclusions[0]
    action = Markup(
        'Take the <a href="#thresholds">alarm thresholds</a>, then judge recordings: '
        "<code>wearscope detect DATA</code>."
    )
    if not one.detector or np.isnan(one.wear):
        action = Markup('See <a href="#q2">which detector comes closest</a>, or let the factors vary less.')
    if pages:
        action = Markup('See <a href="#robots">each robot\'s own page</a>.')
    caveat = "" if pages else _caveat(study, one.detector)
    answer = " ".join(filter(None, [conclude(study, one), trust.tell_basis(study)]))
    kind = certainty(one)
    if better := tell_withheld(study, one):
        kind, caveat = "unsure" if kind == "good" else kind, better
    return Strip(answer, kind, tell_sure(study, one), caveat, action)


def tell_withheld(study: Study, one: Conclusion) -> str:
    """That a withheld detector has a larger median SNR than the recommended one; else empty."""
    if study.rankings is None or not one.detector:
        return ""
    own = study.rankings[study.rankings["robot"] == one.robot].set_index("fda")["median"]
    better = [name for name in one.withheld if own.get(name, 0.0) > own.get(one.detector, np.inf)]
    if not better:
        return ""
    has, what = ("has", "its surrogate") if len(better) == 1 else ("have", "their surrogates")
    return (
        f"{study.join_detectors(better)} {has} a larger signal-to-noise ratio and "
        f"{'is' if len(better) == 1 else 'are'} withheld: direct simulation contradicts {what}."
    )


def _caveat(study: Study, detector: str) -> str:
    """What would change the answer most, the first that applies."""
    doubts = [
        text for text in trust.doubts(study) if detector and f" of {study.detector_name(detector)}:" in text
    ]
    if first := [*doubts, *filter(None, [trust.contradicted(study, detector)])]:
        return first[0]
    if assumed := trust.assumed_robots(study):
        moved = trust.tell_moved(study, detector)
        if len(assumed) == len(study.sources):
            return f"It holds for a robot with the numbers assumed for {join_words(assumed)}. {moved}"
        return f"{join_words(assumed)} {'has' if len(assumed) == 1 else 'have'} assumed numbers. {moved}"
    return SIMULATED


def conclude(study: Study, one: Conclusion) -> str:
    """What to use, and what it finds."""
    where = f"On {one.robot}: " if one.robot else ""
    if not one.detector:
        why = "none sees wear"
        if one.upper:
            why = (
                f"apart from {study.join_detectors(one.upper)}, which {_told(one)} the simulator's law, {why}"
            )
        if one.withheld:
            why = f"the answers of {study.join_detectors(one.withheld)} are withheld"
        return f"{where}No detector can be recommended: {why}."
    name = study.detector_name(one.detector)
    if np.isnan(one.wear):
        return (
            f"{where}{name} sees wear best, but no change of wear that was simulated is "
            f"{'surely ' if one.shown_sure else ''}found: not in half of its "
            f"{count_text(one.cells, 'combination')} {_CELLS}, even at the smallest variation of the other "
            "factors."
        )
    finds = "It finds" if one.shown_sure else "By the estimates alone, it finds"
    fault = study.factor("f")
    found = f"{finds} {factor_name(fault)} of {quantity_text(one.wear, fault.unit)} or more"
    many = (
        ""
        if one.cells_sure == one.cells
        else f", in {one.cells_sure} of {count_text(one.cells, 'combination')} {_CELLS}"
    )
    others = study.join_detectors(one.tied_with, "or")
    tie = f", not told apart from {others}" if others else ""
    return f"{where}Use {name}{tie}. {found}{tell_friction(study, one.wear, one.robot)}{many}."


def _told(one: Conclusion) -> str:
    return "is told" if len(one.upper) == 1 else "are told"


def tell_friction(study: Study, wear: float, robot: str = "") -> str:
    """What a change of wear is as friction, as a clause; empty where the study does not say."""
    rise = friction_rise(study, wear, robot)
    if rise is None:
        return ""
    span = " to ".join(dict.fromkeys(f"{100 * end:.2g}" for end in rise))
    return f", which is {span} % more friction at a tenth of the top speed"


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


def tell_sure(study: Study, one: Conclusion) -> str:
    """How sure the conclusion is, and while what."""
    if not one.detector or np.isnan(one.wear):
        return "Nothing is recommended that was not found."
    text = f"At most {100 * one.p_f:g} % false alarms and at least {100 * one.p_d:g} % detection"
    if one.shown_sure:
        every = one.cells_sure == one.cells
        cells = (
            "for every robot, test-cycle and axis" if every else f"in {one.cells_sure} of {one.cells} of them"
        )
        text += f" {cells}, with 95 % confidence in the surrogates."
    else:
        text += " by the estimates; the surrogates' uncertainty was not counted."
    bounds = []
    for bound in one.bounds:
        factor, more = study.factor(bound.factor), " or more" if bound.largest else ""
        size = quantity_text(1.96 * bound.sigma, factor.unit)
        bounds.append(f"{factor_name(factor)} within ±{size}{more}")
    return f"{text} This holds while one factor varies: {join_words(bounds, 'or')}." if bounds else text


def qualify(study: Study, one: Conclusion) -> list[str]:
    """What the conclusion leaves open."""
    said = []
    if one.tied_with:
        names = study.join_detectors([one.detector, *one.tied_with])
        said.append(
            f"The signal-to-noise ratios of {names} are not told apart at 95 %; the first is sure on the "
            "largest part of what was simulated."
        )
    if one.detector and not np.isnan(one.wear):
        said.append("One factor varies at a time, normally distributed; the ranges hold 95 % of it.")
    if one.upper:
        names = study.join_detectors(one.upper)
        said.append(
            f"{names} {_told(one)} the friction law that the simulator itself uses: an upper bound, which no "
            "plant can have. It is neither ranked nor recommended."
        )
        said += trust.mismatch_outcome(study, one.upper)
    if one.withheld:
        said.append(f"Withheld, as direct simulation contradicts them: {study.join_detectors(one.withheld)}.")
    elif study.audit is None:
        said.append("No direct simulation was run to check it.")
    return said


def certainty(one: Conclusion) -> str:
    """Colour of the conclusion: good, unsure or bad."""
    if not one.detector or np.isnan(one.wear):
        return "bad"
    sure = one.shown_sure and one.cells_sure == one.cells and not one.tied_with
    return "good" if sure else "unsure"


def thresholds_of(study: Study, one: Conclusion) -> pd.DataFrame:
    """Thresholds that belong to a conclusion, a row a cell."""
    if study.thresholds is None or study.thresholds.empty:
        return pd.DataFrame(columns=["robot", "cycle", "axis", "fda", "threshold", "asked"])
    return study.thresholds[study.thresholds["asked"] == one.robot]
