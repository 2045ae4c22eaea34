"""How far the answers can be trusted: fits, audit, failed points."""

import numpy as np
import pandas as pd

from wearscope.reporting.labels import count_text
from wearscope.reporting.page import format_number
from wearscope.reporting.study import Study

POOR_FIT = 50.0
"""Fit [%] below which what a surrogate says is doubted: it leaves more than a quarter of the variance."""


def doubts(study: Study) -> list[str]:
    """Detectors whose answers to Q-2 and Q-3 rest on surrogates that do not hold, each with the reason."""
    sentences = []
    model = study.config["scope"]["model"]
    for fda, rows in study.validation[study.validation["model"] == model].groupby("fda", sort=True):
        reasons = []
        fit = rows["fit"].to_numpy(dtype=float)
        fit = fit[np.isfinite(fit)]
        if fit.size and np.median(fit) < POOR_FIT:
            middle = f"{format_number(float(np.median(fit)), 2)} % in the median"
            reasons.append(f"its {model} model fits the validation runs to {middle}")
        if study.audit is not None:
            good = study.audit[(study.audit["fda"] == fda) & ~study.audit["failed"]]
            if len(good) and good["inside"].mean() < 0.5:
                reasons.append(f"the audit held {_share(good['inside'], 'value')}")
        if reasons:
            sentences.append(f"Do not trust what Q-2 and Q-3 say of {fda}: {' and '.join(reasons)}.")
    return sentences


def audit_outcome(study: Study) -> list[str]:
    """What direct simulation said about the surrogates, or that it was not asked."""
    if study.audit is None or study.audit.empty:
        return ["Not audited: the study has no direct simulation to hold the surrogates against."]
    audit = study.audit
    good = audit[~audit["failed"]]
    points = count_text(audit["point"].nunique(), "point")
    text = (
        f"Simulated directly at {points}, {_share(good['inside'], 'value')} lie within the surrogate's 95 % "
        "prediction interval"
    )
    far = good[good["extrapolated"]]
    if len(far) == len(good):
        text += "; it extrapolates at all of them"
    elif len(far):
        text += f"; where it extrapolates, {_share(far['inside'], 'value')}"
    sentences = [text + "."]
    by_detector = [f"{fda} {_share(rows['inside'])}" for fda, rows in good.groupby("fda", sort=True)]
    if len(by_detector) > 1:
        sentences.append(f"By detector: {', '.join(by_detector)}.")
    failed = len(audit) - len(good)
    if failed:
        reason = audit.loc[audit["failed"], "status"].iloc[0] if "status" in audit else ""
        why = f" (first: {reason})" if reason else ""
        sentences.append(f"Failed and left out: {count_text(failed, 'audited value')}{why}.")
    if study.audit_verdicts is not None and len(study.audit_verdicts):
        agrees = study.audit_verdicts["agrees"]
        sentences.append(f"{_share(agrees, 'scope verdict')} checked in that way agree.")
    else:
        sentences.append("No scope verdict could be checked directly.")
    return sentences


def _share(flags: pd.Series, noun: str = "") -> str:
    """``3 of 4 values (75 %)``."""
    n = len(flags)
    percent = f" ({100 * float(flags.mean()):.0f} %)" if n else ""
    return f"{int(flags.sum())} of {count_text(n, noun) if noun else n}{percent}"


def failed_simulations(study: Study) -> list[str]:
    """How many points were simulated in vain, where and why; [] where none was."""
    failed = study.failed_simulations
    if failed.empty:
        return []
    first = failed.iloc[0]
    return [
        f"{count_text(len(failed), 'simulation')} failed, the first at {first['robot']}, "
        f"{first['cycle']}, {first['set']} point {first['point']}: {first['reason']}. No detector has "
        "a value there; surrogates, validation and all that follows rest on the other points."
    ]


def failed_points(study: Study) -> str:
    """How many points failed for a detector, and where most."""
    if study.failures.empty:
        return "No detector failed at any point."
    worst = study.failures.sort_values("failed", ascending=False, kind="stable").iloc[0]
    total = int(study.failures["failed"].sum())
    return (
        f"{count_text(total, 'test quantity', 'test quantities')} failed in "
        f"{count_text(len(study.failures), 'cell and set', 'cells and sets')}; most in {worst['fda']}, "
        f"{worst['robot']}, {worst['cycle']}, axis {worst['axis']}, {worst['set']}: {worst['failed']} of "
        f"{worst['points']} ({worst['first_reason']}). Failed points are left out, never counted as zero."
    )


def surrogate_quality(study: Study) -> str:
    """How well the surrogate that is asked fits the validation runs."""
    model = study.config["scope"]["model"]
    rows = study.validation[study.validation["model"] == model]
    fit = rows["fit"].to_numpy(dtype=float)
    good = fit[np.isfinite(fit)]
    if not good.size:
        return f"The {model} model has no fit on the validation runs in any cell."
    missing = f"; {count_text(fit.size - good.size, 'cell')} n/a" if fit.size > good.size else ""
    medians = [
        f"{fda} {format_number(float(np.nanmedian(part)), 2)} %" if np.isfinite(part).any() else f"{fda} n/a"
        for fda, part in rows.groupby("fda", sort=True)["fit"]
    ]
    poor = int((good < POOR_FIT).sum())
    return (
        f"The {model} model fits the validation runs to these medians: {', '.join(medians)}; "
        f"{format_number(float(good.min()))} % at worst, below {POOR_FIT:g} % in {poor} of "
        f"{count_text(good.size, 'cell')}{missing}."
    )
