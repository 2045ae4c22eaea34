"""A study in plain sentences: its conclusion, answers to Q-1, Q-2 and Q-3, and how far they can be trusted.

They are only as certain as their intervals allow. Trust rests on fits, the audit and failed points.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.evaluation.conclusion import Bound, Conclusion
from wearscope.evaluation.ranking import SETTLED
from wearscope.evaluation.scope import count_matrix
from wearscope.reporting.findings import SMALL
from wearscope.reporting.labels import (
    PARAMETERS,
    count_text,
    factor_name,
    finite,
    group_columns,
    group_name,
    join_some,
    join_words,
    quantity_text,
    split_groups,
    term_factors,
    term_name,
    unit_text,
    words,
)
from wearscope.reporting.page import format_number, interval_text, say, say_lines
from wearscope.reporting.page_strip import Strip
from wearscope.reporting.study import Study

if TYPE_CHECKING:
    from wearscope.designs.factors import Factor

CHOSEN = "chosen"
_TRUST = "study/trust_words.html"
#: Path of the Coulomb friction, which the direct question of a user's own study doubles (`starters.study`).
_COULOMB = "effects.friction_wear_temperature.all.eta0 %"
POOR_FIT = 50.0
"""Fit [%] below which what a surrogate says is doubted: it leaves more than a quarter of the variance."""


def tell_trust(study: Study) -> list[Markup]:
    """Sentences on how far the answers can be trusted, the most important first."""
    asked = [*audit_outcome(study), *direct_outcome(study)]
    lost = [*failed_simulations(study), *ask_moved(study)]
    return [surrogate_quality(study), *asked, *lost]


def doubts(study: Study) -> list[Markup]:
    """Detectors whose answers to Q-2 and Q-3 rest on surrogates that do not hold, each with the reason."""
    model, runs, rows = _asked_fits(study)
    judged = []
    for fda, fits in rows.groupby("fda", sort=True)["fit"]:
        name, withheld, fit, held = study.detector_name(fda), fda in study.withheld(), _median(fits), ""
        if study.audit is not None:
            good = study.audit[(study.audit["fda"] == fda) & ~study.audit["failed"]]["inside"]
            held = _share(good, "value") if withheld or (len(good) and good.mean() < 0.5) else ""
        poor = format_number(fit, 2) if fit < POOR_FIT else ""
        judged.append(SimpleNamespace(name=name, withheld=withheld, fit=poor, held=held))
    answers, left = study.audit_answers, ""
    if answers is not None:
        left = study.join_detectors(answers.loc[answers["answer"] == "not audited", "fda"])
    return say_lines(_TRUST, "doubts", judged, model, runs, left)


def _median(fits: pd.Series) -> float:
    """Median of the finite fits; NaN without any."""
    return float(np.median(finite(fits))) if finite(fits).size else np.nan


def _asked_fits(study: Study) -> tuple[str, str, pd.DataFrame]:
    """The surrogate behind the scope, the runs that check it, and its fits by cell."""
    model = study.config["scope"]["model"]
    runs = "checking" if model == CHOSEN else "validation"
    if model == CHOSEN and study.chosen is not None:
        return "chosen surrogate", runs, study.chosen
    return f"{model} model", runs, study.validation[study.validation["model"] == model]


def audit_outcome(study: Study) -> list[Markup]:
    """Result of checking the surrogates by direct simulation, or that the study did not ask for it."""
    audit, verdicts = study.audit, study.audit_verdicts
    if audit is None or audit.empty:
        return say_lines(_TRUST, "audit", None)
    good, failed = audit[~audit["failed"]], audit[audit["failed"]]
    far, by_detector = good[good["extrapolated"]], good.groupby("fda", sort=True)["inside"]
    found = SimpleNamespace(
        points=audit["point"].nunique(),
        inside=_share(good["inside"], "value"),
        far=_share(far["inside"], "value") if len(far) else "",
        every_far=len(far) == len(good),
        detectors=[f"{study.detector_name(fda)} {_share(rows)}" for fda, rows in by_detector],
        failed=len(failed),
        reason=failed["status"].iloc[0] if len(failed) and "status" in failed else "",
        agreeing="" if verdicts is None or verdicts.empty else _share(verdicts["agrees"], "scope verdict"),
    )
    return say_lines(_TRUST, "audit", found)


def _share(flags: pd.Series, noun: str = "") -> str:
    """``3 of 4 values (75 %)``."""
    n = len(flags)
    percent = f" ({100 * float(flags.mean()):.0f} %)" if n else ""
    return f"{int(flags.sum())} of {count_text(n, noun) if noun else n}{percent}"


def tell_snr(row: Any, kind: str) -> str:
    """A row's SNR with its interval, from the columns of a kind."""
    return interval_text(*(getattr(row, name) for name in (f"snr_{kind}", f"{kind}_low", f"{kind}_high")))


def direct_outcome(study: Study) -> list[Markup]:
    """For how many detectors direct simulation agrees with the surrogate; [] where it was not asked."""
    table = study.direct
    if table is None or table.empty:
        return []
    known, first = table["agrees"].dropna().astype(bool), table.iloc[0]
    return say_lines(_TRUST, "direct", tell_cell(first), int(first["runs"]), int(known.sum()), len(known))


def tell_cell(row: Mapping[str, Any]) -> str:
    """Robot, test-cycle and axis of a row."""
    return f"{row['robot']}, {words(row['cycle'])}, axis {row['axis']}"


def tell_mismatch(study: Study) -> str:
    """Differences between the robot of the mismatch and its model."""
    told = []
    for path, value in study.config["direct"]["mismatch"].items():
        parts = path.removesuffix(" %").split(".")
        name = PARAMETERS.get(parts[-1], words(f"{parts[-1]} of {parts[1]}"))
        size = f"changed by {value:+g} %" if path.endswith(" %") else f"of {value:g}"
        told.append(f"{name} {size.replace('-', chr(0x2212))}")
    return join_words(told)


def mismatch_outcome(study: Study, detectors: Sequence[str]) -> list[Markup]:
    """SNR of some detectors where the robot differs from their model; [] where it was not asked."""
    table = study.mismatch
    if table is None or table.empty:
        return []
    parts = [
        f"{study.detector_name(row.fda)} {tell_snr(row, 'mismatch')} instead of {tell_snr(row, 'ideal')}"
        for row in table[table["fda"].isin(detectors)].itertuples()
    ]
    return say_lines(_TRUST, "mismatch", tell_cell(table.iloc[0]), parts)


def assumed_robots(study: Study) -> list[str]:
    """Robots of which some number is assumed, not given."""
    return [robot for robot, texts in study.sources.items() if any("assumed" in text for text in texts)]


def tell_basis(study: Study) -> str:
    """Whether the robots' numbers are given or assumed; empty where the study does not say."""
    told = say("study/strip.html", "basis", len(study.sources), join_words(assumed_robots(study)))
    return told.striptags()


def tell_assumed(study: Study, detector: str) -> str:
    """Robots with assumed numbers and what that may change; empty where there are none."""
    assumed = assumed_robots(study)
    every = len(assumed) == len(study.sources)
    return say(_TRUST, "assumed", assumed, every, tell_moved(study, detector))


def tell_moved(study: Study, detector: str) -> str:
    """Change of a detector's SNR where the robot differs from the assumptions, or how to ask for it."""
    table = study.mismatch
    known = () if table is None else table[table["fda"] == detector].itertuples()
    for row in known:
        told = tell_snr(row, "mismatch"), tell_snr(row, "ideal"), f"{words(row.cycle)}, axis {row.axis}"
        return say(_TRUST, "moved", tell_mismatch(study), study.detector_name(detector), *told)
    return say(_TRUST, "moved")


def ask_moved(study: Study) -> list[Markup]:
    """Commands that compute how half or double the friction changes the answers, where friction is assumed.

    There are none where the study has computed that already.
    """
    if not assumed_robots(study) or _COULOMB in study.config["direct"]["mismatch"]:
        return []
    setting = f'direct.mismatch={{"{_COULOMB}": 100}}'
    return say_lines(_TRUST, "ask_moved", study.config["study"], setting)


def contradicted(study: Study, detector: str) -> str:
    """Sentence where direct simulation gives a detector another SNR, which then counts; else empty."""
    if study.direct is None or study.direct.empty:
        return ""
    table = study.direct[(study.direct["fda"] == detector) & (study.direct["agrees"] == 0)]
    for row in table.itertuples():
        there, surrogate = f"{words(row.cycle)}, axis {row.axis}", format_number(row.snr_surrogate)
        return say(_TRUST, "contradicted", there, tell_snr(row, "direct"), surrogate)
    return ""


def failed_simulations(study: Study) -> list[Markup]:
    """Number of points whose simulation failed, where and why; [] without any."""
    failed = study.failed_simulations
    if failed.empty:
        return []
    first = failed.iloc[0]
    return say_lines(_TRUST, "failed", len(failed), first, words(first["cycle"]))


def dropped_factors(study: Study) -> list[str]:
    """Factors that move no torque of a robot and were dropped from its answers; [] where there is none."""
    if study.screening is None:
        return []
    return [
        f"{factor_name(study.factor(row.factor)).capitalize()} moves no recorded torque of {row.robot} and "
        "was dropped from the answers on factors and scope."
        for row in study.screening[study.screening["dropped"]].itertuples()
    ]


def count_failed(study: Study) -> list[str]:
    """How many points failed, in short; [] where none did."""
    total = count_text(int(study.failures["failed"].sum()), "test quantity", "test quantities")
    return [] if study.failures.empty else [f"{total} failed: left out, never counted as zero."]


def surrogate_quality(study: Study) -> Markup:
    """How well the surrogate that answers fits the runs that check it."""
    model, runs, rows = _asked_fits(study)
    good = finite(rows["fit"])
    medians = rows.groupby("fda", sort=True)["fit"].agg(_median)
    found = SimpleNamespace(
        model=model,
        runs=runs,
        cells=good.size,
        missing=len(rows) - good.size,
        medians=[
            f"{study.detector_name(fda)} {format_number(fit, 2)}{'' if np.isnan(fit) else ' %'}"
            for fda, fit in medians.items()
        ],
        lowest=format_number(float(good.min(initial=np.inf))),
        poor_fit=f"{POOR_FIT:g}",
        poor=int((good < POOR_FIT).sum()),
        goal=f"{study.config['surrogates']['filling']['goal']:g}",
        states=None,
    )
    if "state" in rows:
        states = {"reached": "reached", "ceiling": "at ceiling", "short": "short"}
        found.states = {key: int((rows["state"] == state).sum()) for key, state in states.items()}
    return say(_TRUST, "quality", found)


#: Share of a joint's top speed at which a wear level is expressed as friction.
SPEED = 0.1
#: Caveat of a study where no other caveat is more important.
SIMULATED = "Everything is simulated; recordings of the robot say how well (wearscope diagnose)."
_STRIP = "study/strip.html"


def study_strip(study: Study, pages: bool = False) -> Strip | None:
    """Strip of the study: which detector to use, by robot where they differ; None without a conclusion.

    Parameters
    ----------
    study : Study
    pages : bool
        Whether each robot has a page of its own, with its thresholds and its caveat.
    """
    if not study.conclusions:
        return None
    shown = study.conclusions[:1] if pages else recommendations(study)
    told = [describe(study, one, pages) for one in shown]
    kinds = [certainty(study, one) for one in shown]
    answer = " ".join([*(say(_STRIP, "answer", one).striptags() for one in told), tell_basis(study)])
    kind = next(one for one in ("bad", "unsure", "good") if one in kinds)
    caveat = "" if pages else _caveat(study, shown, told)
    return Strip(answer.strip(), kind, say(_STRIP, "sure", told), caveat, say(_STRIP, "action", told[0]))


def recommendations(study: Study) -> Sequence[Conclusion]:
    """Recommendations: one for all robots where each has the same detector, else one for each robot."""
    whole, *own = study.conclusions
    return own if any(one.detector != whole.detector for one in own) else [whole]


def describe(study: Study, one: Conclusion, pages: bool = False) -> SimpleNamespace:
    """Values of a recommendation that the strip's template needs."""
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
        guessed=bool(assumed_robots(study)),
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
    """The most important caveat: the first one that applies."""
    codes = [one.detector for one in shown if one.detector]
    known = [
        tell_withheld(study, shown[0]),
        *(say(_STRIP, "narrow", one) for one in told if one.shifts),
        *(text for text in doubts(study) for one in told if one.name and f" of {one.name}:" in text),
        *(contradicted(study, code) for code in codes),
        tell_assumed(study, codes[0]) if codes else "",
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
    return say(_STRIP, "better", study.join_detectors(better), len(better)).striptags()


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
    """Sentences on points that the conclusion leaves open."""
    one = study.conclusions[0]
    told = describe(study, one)
    law = [*(mismatch_outcome(study, one.upper) if one.upper else []), say(_STRIP, "bound", told)]
    checked = say(_STRIP, "checked", told, study.audit is not None)
    return list(filter(None, [say(_STRIP, "tied", told), say(_STRIP, "ranges", told), *law, checked]))


def certainty(study: Study, one: Conclusion) -> str:
    """Colour of a recommendation: good, unsure or bad."""
    if not one.detector or np.isnan(one.wear):
        return "bad"
    sure = one.shown_sure and one.cells_sure == one.cells and not one.tied_with
    settled = one.agree >= SETTLED or not one.resamplings
    wide = not any(_is_narrow(study, bound) for bound in one.bounds)
    return "good" if sure and settled and wide and not tell_withheld(study, one) else "unsure"


def thresholds_of(study: Study, one: Conclusion) -> pd.DataFrame:
    """Thresholds that belong to a conclusion, one row per cell."""
    if study.thresholds is None or study.thresholds.empty:
        return pd.DataFrame(columns=["robot", "cycle", "axis", "fda", "threshold", "asked"])
    return study.thresholds[study.thresholds["asked"] == one.robot]


HALF = 0.5
#: Largest number of terms that a sentence names.
_MOST_TERMS = 3
_ANSWERS = "study/answers.html"


@dataclass(frozen=True)
class Tolerance:
    """How much variation of one factor a group of cells tolerates.

    `share` is the part of all verdicts on the grid that pass. At the largest coded change `delta` of the
    fault, at least half the cells pass up to `sigma`: NaN where they fail even at the smallest sigma, the
    largest sigma where they pass up to the end of the grid.
    """

    group: str
    share: float
    delta: float
    sigma: float
    largest: bool


def relevant_factors(study: Study) -> list[Markup]:
    """Answer to Q-1: what outweighs wear by group, the detector to use first, and what hardly matters."""
    table = study.sensitivity
    by = group_columns(table)
    confirmed = _confirmed_terms(study, by)
    used = study.detector_name(study.recommended()) if study.recommended() else ""
    groups = sorted(split_groups(table, by, study.detector_names()), key=lambda one: one[0] != used)
    main = table[~table["term"].str.contains(r"[:^]", regex=True) & (table["term"] != "f")]
    quiet = [
        term_name(str(term), study.factors)
        for term, rows in main.groupby("term", sort=True)
        if (rows["median_absolute"] < SMALL).all()
        and not any(term in term_factors(one) for terms in confirmed.values() for one in terms)
    ]
    found = [_outweighing(study, name, rows, confirmed.get(name)) for name, rows in groups]
    return say_lines(_ANSWERS, "relevant", found, quiet, f"{SMALL:g}")


def _confirmed_terms(study: Study, by: list[str]) -> dict[str, set[str]]:
    """Terms of second order that outweigh wear in more than half the cells of a group by the full model.

    Model (19) has no square of f: where y curves with f, part of that curvature appears in the other squares.
    Empty where the study has no full model.
    """
    rows = study.surrogates[study.surrogates["model"] == "full"]
    rows = rows[rows["term"].str.contains(r"[:^]", regex=True) & rows["theta_normalised"].notna()]
    found = {}
    for name, group in split_groups(rows, by, study.detector_names()):
        share = (group["theta_normalised"].abs() > 1).groupby(group["term"]).mean()
        found[name] = set(share.index[share > HALF])
    return found


def _outweighing(study: Study, name: str, rows: pd.DataFrame, confirmed: set[str] | None) -> SimpleNamespace:
    """Terms that outweigh wear in more than half the cells of a group, and in what share of them."""
    strong = rows[(rows["share_relevant"] > HALF) & (rows["term"] != "f")]
    if confirmed is not None:
        second = strong["term"].str.contains(r"[:^]", regex=True)
        strong = strong[~second | strong["term"].isin(confirmed)]
    strong = strong.sort_values(["share_relevant", "median_absolute"], ascending=False, kind="stable")
    first = strong.head(_MOST_TERMS)
    return SimpleNamespace(
        name=name,
        cells=int(rows["n"].max()),
        terms=[term_name(str(term), study.factors) for term in first["term"]],
        more=len(strong) - len(first),
        least=f"{100 * first['share_relevant'].min():.0f}",
        most=f"{100 * first['share_relevant'].max():.0f}",
        unsure=not (first["share_low"] > HALF).all(),
    )


def best_detector(study: Study) -> list[Markup]:
    """Answer to Q-2: the ranking with intervals, ties, and the cells without an SNR or with a falling y."""
    table, out = study.ranking, [*study.withheld(), *study.upper()]
    by = group_columns(table)
    if "fda" in by:
        table = table[~table["fda"].isin(out)]
    full = study.detector_names()
    rows = [(group_name(by, [row[name] for name in by], full), row) for _, row in table.iterrows()]
    known = [(name, row) for name, row in rows if np.isfinite(row["median"])]
    if not known:
        return say_lines(_ANSWERS, "ranking", None)
    best, row = known[0]
    medians = [
        f"{name} {interval_text(one['median'], one['median_low'], one['median_high'])}" for name, one in known
    ]
    tied = [one for one in str(row["tied_with"]).split(", ") if one and one not in out]
    told = SimpleNamespace(
        best=best,
        few="interval_from" in table and (table["interval_from"] == "each cell").any(),
        medians=join_some(medians, 6),
        positive=row["median"] > 0,
        tied=join_words([group_name(by, one.split("/"), full) for one in tied], "or"),
        alone=len(known) == 1,
    )
    unknown = [name for name, one in rows if not np.isfinite(one["median"])]
    return say_lines(_ANSWERS, "ranking", told, unknown, study.snr["status"].value_counts().to_dict())


def tolerances(study: Study, factor: str) -> list[Tolerance]:
    """Variation of a factor that half the cells of each group tolerate; the largest share comes first."""
    found = []
    by = list(study.config["scope"]["group_by"])
    asked = study.exact_scope(factor)
    left_out = [*study.withheld(), *study.upper()]
    for name, rows in split_groups(asked[~asked["fda"].isin(left_out)], by, study.detector_names()):
        cells = len(rows[["robot", "cycle", "axis", "fda"]].drop_duplicates())
        sigma, grid, count = count_matrix(rows, rows["passes"])
        passing = count[-1] >= HALF * cells
        reached = len(passing) if passing.all() else int(np.argmin(passing))
        value = float(sigma[reached - 1]) if reached else np.nan
        share = float(rows["passes"].mean())
        found.append(Tolerance(name, share, float(grid[-1]), value, reached == len(passing)))
    return sorted(found, key=lambda one: -one.share)


def effective_scope(study: Study) -> list[Markup]:
    """Answer to Q-3: on what share of the grid, by factor that varies, then how much the best tolerates."""
    groups = [(name, tolerances(study, name)) for name in study.config["scope"]["factors"]]
    told = [_describe_scope(study, name, found) for name, found in groups if found]
    detected, false = (f"{100 * study.config['scope'][name]:g}" for name in ("p_d", "p_f"))
    return say_lines(_ANSWERS, "scope", told, detected, false)


def _describe_scope(study: Study, name: str, found: Sequence[Tolerance]) -> SimpleNamespace:
    """What the groups tolerate of a factor: shares of all, empty where each is zero, and the best's sigma."""
    fault, factor, best = study.factor("f"), study.factor(name), found[0]
    sigma = format_number(best.sigma * factor.step, 2)
    return SimpleNamespace(
        factor=factor_name(factor),
        listed=join_some([f"{one.group} {100 * one.share:.0f} %" for one in found if best.share], 6),
        group=best.group,
        change=f"{format_number(best.delta * fault.step, 2)} {unit_text(fault.unit)}".strip(),
        sigma="" if np.isnan(best.sigma) else f"{sigma} {unit_text(factor.unit)}".strip(),
        largest=best.largest,
    )
