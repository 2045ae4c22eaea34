"""How far the answers can be trusted: fits, audit, failed points."""

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.reporting.labels import PARAMETERS, count_text, factor_name, finite, join_words, words
from wearscope.reporting.page import format_number, interval_text, say, say_lines
from wearscope.reporting.study import Study

CHOSEN = "chosen"
_WORDS = "study/trust_words.html"
#: Path of the number that own studies double (`starters.study`), with the study's direct question.
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
    return say_lines(_WORDS, "doubts", judged, model, runs, left)


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
    """Result of checking the surrogates by direct simulation, or that nobody asked for it."""
    audit, verdicts = study.audit, study.audit_verdicts
    if audit is None or audit.empty:
        return say_lines(_WORDS, "audit", None)
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
    return say_lines(_WORDS, "audit", found)


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
    return say_lines(_WORDS, "direct", tell_cell(first), int(first["runs"]), int(known.sum()), len(known))


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
    return say_lines(_WORDS, "mismatch", tell_cell(table.iloc[0]), parts)


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
    return say(_WORDS, "assumed", assumed, every, tell_moved(study, detector))


def tell_moved(study: Study, detector: str) -> str:
    """Change of a detector's SNR where the robot differs from the assumptions, or how to ask for it."""
    table = study.mismatch
    known = () if table is None else table[table["fda"] == detector].itertuples()
    for row in known:
        told = tell_snr(row, "mismatch"), tell_snr(row, "ideal"), f"{words(row.cycle)}, axis {row.axis}"
        return say(_WORDS, "moved", tell_mismatch(study), study.detector_name(detector), *told)
    return say(_WORDS, "moved")


def ask_moved(study: Study) -> list[Markup]:
    """Commands that ask what half or double the friction changes, where it is assumed and not asked yet."""
    if not assumed_robots(study) or _COULOMB in study.config["direct"]["mismatch"]:
        return []
    setting = f'direct.mismatch={{"{_COULOMB}": 100}}'
    return say_lines(_WORDS, "ask_moved", study.config["study"], setting)


def contradicted(study: Study, detector: str) -> str:
    """Sentence where direct simulation gives a detector another SNR, which then counts; else empty."""
    if study.direct is None or study.direct.empty:
        return ""
    table = study.direct[(study.direct["fda"] == detector) & (study.direct["agrees"] == 0)]
    for row in table.itertuples():
        there, surrogate = f"{words(row.cycle)}, axis {row.axis}", format_number(row.snr_surrogate)
        return say(_WORDS, "contradicted", there, tell_snr(row, "direct"), surrogate)
    return ""


def failed_simulations(study: Study) -> list[Markup]:
    """Number of points whose simulation failed, where and why; [] without any."""
    failed = study.failed_simulations
    if failed.empty:
        return []
    first = failed.iloc[0]
    return say_lines(_WORDS, "failed", len(failed), first, words(first["cycle"]))


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
    return say(_WORDS, "quality", found)
