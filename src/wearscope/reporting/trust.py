"""How far the answers can be trusted: fits, audit, failed points."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.reporting.labels import PARAMETERS, count_text, factor_name, finite, join_words, words
from wearscope.reporting.page import format_number, interval_text, say
from wearscope.reporting.study import Study

CHOSEN = "chosen"
#: Path of the number that own studies double (`starters.study`), with the study's direct question.
_COULOMB = "effects.friction_wear_temperature.all.eta0 %"
POOR_FIT = 50.0
"""Fit [%] below which what a surrogate says is doubted: it leaves more than a quarter of the variance."""


def tell_trust(study: Study) -> list[str]:
    """Sentences on how far the answers can be trusted, the most important first."""
    asked = [*audit_outcome(study), *direct_outcome(study)]
    lost = [*failed_simulations(study), *ask_moved(study)]
    return [surrogate_quality(study), *asked, *lost]


def doubts(study: Study) -> list[str]:
    """Detectors whose answers to Q-2 and Q-3 rest on surrogates that do not hold, each with the reason."""
    sentences = []
    model, runs, rows = _asked_fits(study)
    for fda, fits in rows.groupby("fda", sort=True)["fit"]:
        reasons, withheld = [], fda in study.withheld()
        middle = float(np.median(finite(fits))) if finite(fits).size else np.inf
        if middle < POOR_FIT:
            reasons.append(f"its {model} fits the {runs} runs to {format_number(middle, 2)} % in the median")
        if study.audit is not None:
            good = study.audit[(study.audit["fda"] == fda) & ~study.audit["failed"]]["inside"]
            if withheld or (len(good) and good.mean() < 0.5):
                reasons.append(f"the audit held {_share(good, 'value')}")
        what = "Withheld are" if withheld else "Do not trust"
        if reasons:
            name = study.detector_name(fda)
            sentences.append(f"{what} signal-to-noise ratio and scope of {name}: {' and '.join(reasons)}.")
    answers = study.audit_answers
    if answers is not None and (answers["answer"] == "not audited").any():
        left = study.join_detectors(answers.loc[answers["answer"] == "not audited", "fda"])
        sentences.append(f"Not audited, as every value failed: {left}.")
    return sentences


def _asked_fits(study: Study) -> tuple[str, str, pd.DataFrame]:
    """The surrogate behind the scope, the runs that check it, and its fits by cell."""
    model = study.config["scope"]["model"]
    runs = "checking" if model == CHOSEN else "validation"
    if model == CHOSEN and study.chosen is not None:
        return "chosen surrogate", runs, study.chosen
    return f"{model} model", runs, study.validation[study.validation["model"] == model]


def audit_outcome(study: Study) -> list[str]:
    """Result of checking the surrogates by direct simulation, or that nobody asked for it."""
    if study.audit is None or study.audit.empty:
        return ["Not audited: the study has no direct simulation to hold the surrogates against."]
    audit = study.audit
    good, failed = audit[~audit["failed"]], audit[audit["failed"]]
    far = good[good["extrapolated"]]
    where = f"; where it extrapolates, {_share(far['inside'], 'value')}" if len(far) else ""
    if len(far) == len(good):
        where = "; it extrapolates at all of them"
    sentences = [
        f"Simulated directly at {count_text(audit['point'].nunique(), 'point')}, "
        f"{_share(good['inside'], 'value')} lie within the surrogate's 95 % prediction interval{where}."
    ]
    by_detector = [
        f"{study.detector_name(fda)} {_share(rows)}" for fda, rows in good.groupby("fda", sort=True)["inside"]
    ]
    if len(by_detector) > 1:
        sentences.append(f"By detector: {', '.join(by_detector)}.")
    if len(failed):
        reason = failed["status"].iloc[0] if "status" in failed else ""
        why = f" (first: {reason})" if reason else ""
        sentences.append(f"Failed and left out: {count_text(len(failed), 'audited value')}{why}.")
    verdicts = study.audit_verdicts
    if verdicts is None or verdicts.empty:
        return [*sentences, "No scope verdict could be checked directly."]
    return [*sentences, f"{_share(verdicts['agrees'], 'scope verdict')} checked in that way agree."]


def _share(flags: pd.Series, noun: str = "") -> str:
    """``3 of 4 values (75 %)``."""
    n = len(flags)
    percent = f" ({100 * float(flags.mean()):.0f} %)" if n else ""
    return f"{int(flags.sum())} of {count_text(n, noun) if noun else n}{percent}"


def tell_snr(row: Any, kind: str) -> str:
    """A row's SNR with its interval, from the columns of a kind."""
    return interval_text(*(getattr(row, name) for name in (f"snr_{kind}", f"{kind}_low", f"{kind}_high")))


def direct_outcome(study: Study) -> list[str]:
    """For how many detectors direct simulation agrees with the surrogate; [] where it was not asked."""
    table = study.direct
    if table is None or table.empty:
        return []
    known = table["agrees"].dropna().astype(bool)
    runs = count_text(int(table["runs"].iloc[0]), "simulation")
    return [
        f"Simulated directly: {tell_cell(table.iloc[0])}, {runs} with and without wear. The interval of the "
        f"signal-to-noise ratio overlaps the surrogate's for {int(known.sum())} of "
        f"{count_text(len(known), 'detector')}."
    ]


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


def mismatch_outcome(study: Study, detectors: Sequence[str]) -> list[str]:
    """SNR of some detectors where the robot differs from their model; [] where it was not asked."""
    table = study.mismatch
    if table is None or table.empty:
        return []
    parts = [
        f"{study.detector_name(row.fda)} {tell_snr(row, 'mismatch')} instead of {tell_snr(row, 'ideal')}"
        for row in table[table["fda"].isin(detectors)].itertuples()
    ]
    return [
        "SNR where the robot's friction differs from the law that the detectors hold, "
        f"{tell_cell(table.iloc[0])}: {'; '.join(parts)}."
    ]


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
    if not assumed:
        return ""
    moved = tell_moved(study, detector)
    if len(assumed) == len(study.sources):
        return f"It holds for a robot with the numbers assumed for {join_words(assumed)}. {moved}"
    return f"{join_words(assumed)} {'has' if len(assumed) == 1 else 'have'} assumed numbers. {moved}"


def tell_moved(study: Study, detector: str) -> str:
    """Change of a detector's SNR where the robot differs from the assumptions, or how to ask for it."""
    table = study.mismatch
    rows = table[table["fda"] == detector] if table is not None else None
    if rows is None or rows.empty:
        return "Whether it moves if friction is doubled is not judged; the part on trust has the command."
    row = next(rows.itertuples())
    return (
        f"With {tell_mismatch(study)}, {study.detector_name(detector)} has a signal-to-noise ratio of "
        f"{tell_snr(row, 'mismatch')} instead of {tell_snr(row, 'ideal')}, at "
        f"{words(row.cycle)}, axis {row.axis}."
    )


def ask_moved(study: Study) -> list[Markup]:
    """Commands that ask what half or double the friction changes, where it is assumed and not asked yet."""
    if not assumed_robots(study) or _COULOMB in study.config["direct"]["mismatch"]:
        return []
    setting = f'direct.mismatch={{"{_COULOMB}": SHARE}}'
    command = f"wearscope run {study.config['study']} --set '{setting}'"
    text = "Some numbers are assumed. To see what double the friction changes, run {}; −50 is half of it."
    return [Markup(text).format(Markup("<code>{}</code>").format(command.replace("SHARE", "100")))]


def contradicted(study: Study, detector: str) -> str:
    """Sentence where direct simulation gives a detector another SNR, which then counts; else empty."""
    if study.direct is None or study.direct.empty:
        return ""
    table = study.direct[(study.direct["fda"] == detector) & (study.direct["agrees"] == 0)]
    for row in table.itertuples():
        return (
            f"Directly simulated, its SNR at {words(row.cycle)}, axis {row.axis} is "
            f"{tell_snr(row, 'direct')}; the surrogate says {format_number(row.snr_surrogate)}. The direct "
            "value is the answer there."
        )
    return ""


def failed_simulations(study: Study) -> list[str]:
    """Number of points whose simulation failed, where and why; [] without any."""
    failed = study.failed_simulations
    if failed.empty:
        return []
    first = failed.iloc[0]
    return [
        f"{count_text(len(failed), 'simulation')} failed, the first at {first['robot']}, "
        f"{words(first['cycle'])}, {first['set']} point {first['point']}: {first['reason']}. No detector has "
        "a value there; surrogates, validation and all that follows rest on the other points."
    ]


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


def surrogate_quality(study: Study) -> str:
    """How well the surrogate that answers fits the runs that check it."""
    model, runs, rows = _asked_fits(study)
    good = finite(rows["fit"])
    if not good.size:
        return f"The {model} has no fit on the {runs} runs in any cell."
    missing = f" It is n/a in {count_text(len(rows) - good.size, 'cell')}." if len(rows) > good.size else ""
    medians = [
        f"{study.detector_name(fda)} {format_number(float(np.median(finite(fits))), 2)} %"
        if finite(fits).size
        else f"{study.detector_name(fda)} n/a"
        for fda, fits in rows.groupby("fda", sort=True)["fit"]
    ]
    text = f"Median fit of the {model} on the {runs} runs: {', '.join(medians)}. "
    text += f"The lowest fit is {format_number(float(good.min()))} %. It is "
    if "state" not in rows:
        poor = int((good < POOR_FIT).sum())
        return f"{text}below {POOR_FIT:g} % in {poor} of {count_text(good.size, 'cell')}.{missing}"
    goal = study.config["surrogates"]["filling"]["goal"]
    reached, ceiling, short = (
        int((rows["state"] == one).sum()) for one in ("reached", "at ceiling", "short")
    )
    text += f"{goal:g} % or more in {reached} of {count_text(good.size, 'cell')}"
    text += f", in {ceiling} more as far as the noise of a run allows" if ceiling else ""
    text += f". In {count_text(short, 'cell')} the points did not suffice" if short else ""
    return f"{text}.{missing}"
