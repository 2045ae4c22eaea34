"""The paper's findings and this study's, line by line; every sentence is made from the tables."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from wearscope.evaluation.paired_estimates import (
    Estimate,
    decide,
    estimate_columns,
    estimate_difference,
    nan_mean,
    nan_median,
    pivot_detectors,
)
from wearscope.reporting.labels import count_text, factor_name
from wearscope.reporting.page import format_number
from wearscope.reporting.study import Study

STAND_INS = {"A": "residual_energy", "B": "distribution_distance", "C": "friction_fit"}
"""Modules in the place of the paper's confidential FDAs."""
LARGE, EQUAL, SMALL = 0.5, 1.0, 0.25
"""Median |normalised coefficient| that counts as considerable, as much as wear, and insignificant."""
TABLE_4 = {"full": (83.7, 95.0), "simplified": (64.6, 89.8)}


@dataclass(frozen=True)
class Finding:
    """One line of the comparison.

    Attributes
    ----------
    question : str
    paper : str
        What the paper says.
    here : str
        What this study's tables say, with intervals.
    verdict : str
        agrees, partly, disagrees, undecided (the intervals leave it open), not asked (the study lacks the
        detectors or factors).
    """

    question: str
    paper: str
    here: str
    verdict: str


def compare_with_paper(study: Study) -> list[Finding]:
    """Findings of the paper's Secs. 6.1 to 6.4, each compared with this study's own tables.

    Intervals are 95 %, over the choice of cells (robot, test-cycle, axis resampled together for all
    detectors).
    """
    names = {
        letter: name
        for letter, module in STAND_INS.items()
        if (name := study.detector_of(module)) is not None
    }
    return [
        *_fit_findings(study, names),
        *_sensitivity_findings(study, names),
        _snr_finding(study, names),
        *_scope_findings(study, names),
    ]


def findings_table(findings: Sequence[Finding]) -> pd.DataFrame:
    """``question``, ``paper``, ``here``, ``verdict``."""
    return pd.DataFrame([asdict(one) for one in findings], columns=["question", "paper", "here", "verdict"])


def read_findings(table: pd.DataFrame) -> list[Finding]:
    """The inverse of `findings_table`."""
    return [Finding(*(str(value) for value in row)) for row in table.itertuples(index=False)]


def estimate_text(one: Estimate, unit: str = "") -> str:
    """``2.1 (1.8 to 2.5)`` with unit; n/a where unknown; says so where there is no interval."""
    tail = f" {unit}" if unit else ""
    if np.isnan(one.value):
        return "n/a"
    if np.isnan(one.low):
        return f"{format_number(one.value)}{tail} (no interval, {count_text(one.n, 'cell')})"
    return f"{format_number(one.value)}{tail} ({format_number(one.low)} to {format_number(one.high)})"


def _listed(estimates: dict[str, Estimate], names: Sequence[str], unit: str = "") -> str:
    return ", ".join(f"{name} {estimate_text(estimates[name], unit)}" for name in names)


def _absent(question: str, paper: str, what: str) -> Finding:
    return Finding(question, paper, f"This study lacks {what}.", "not asked")


def coefficients(study: Study, term: str) -> pd.DataFrame:
    """Magnitude of a term's normalised coefficient (8): cells down, detectors across."""
    model = study.config["sensitivity"]["model"]
    rows = study.surrogates[(study.surrogates["model"] == model) & (study.surrogates["term"] == term)]
    wide = pivot_detectors(rows.assign(size=rows["theta_normalised"].abs()), "size")
    return wide.replace([np.inf], np.nan)


def _sensitivity_findings(study: Study, names: dict[str, str]) -> list[Finding]:
    q = "Q-1"
    found = []
    texts = (
        "Temperature considerably affects every FDA.",
        "C has the lowest median coefficient of temperature.",
    )
    warm = study.factors_of("temperature")
    if not warm or not names:
        found += [_absent(q, text, "a temperature factor, or stand-ins for A, B, C") for text in texts]
    else:
        wide = coefficients(study, warm[0])
        medians = estimate_columns(wide)
        here = f"Median |θ̃| of {factor_name(study.factor(warm[0]))}: {_listed(medians, list(names.values()))}"
        found.append(
            Finding(
                q, texts[0], f"{here}; considerable from {LARGE:g}.",
                decide([medians[name].above(LARGE) for name in names.values()]),
            )
        )  # fmt: skip
        found.append(
            _least(q, texts[1], wide, names, "C", f"median |θ̃| of {factor_name(study.factor(warm[0]))}")
        )
    found += _payload_findings(study, names)
    text = "Wear of the other joints and point-to-point delay are insignificant for every FDA."
    quiet = [*study.factors_of("wear"), *study.factors_of("dwell")]
    if not quiet or not names:
        return [*found, _absent(q, text, "other wear and delay, or stand-ins for A, B, C")]
    parts, outcomes = [], []
    for factor in quiet:
        medians = estimate_columns(coefficients(study, factor))
        outcomes += [medians[name].below(SMALL) for name in names.values()]
        parts.append(f"{factor_name(study.factor(factor))}: {_listed(medians, list(names.values()))}")
    here = f"Median |θ̃| of {'; '.join(parts)}; insignificant up to {SMALL:g}."
    return [*found, Finding(q, text, here, decide(outcomes))]


def _payload_findings(study: Study, names: dict[str, str]) -> list[Finding]:
    q = "Q-1"
    texts = (
        "Payload mass error moves A more than wear does.",
        "B and C respond less to payload mass error than A.",
    )
    load = study.factors_of("payload_mass_error")
    if not load or "A" not in names:
        return [_absent(q, text, "payload mass error, or a stand-in for A") for text in texts]
    wide = coefficients(study, load[0])
    medians = estimate_columns(wide)
    a = names["A"]
    others = [names[letter] for letter in ("B", "C") if letter in names]
    what = factor_name(study.factor(load[0]))
    here = f"Median |θ̃| of {what}: {_listed(medians, [a])}; as much as wear is {EQUAL:g}"
    first = Finding(
        q, texts[0], f"{here}{_square_text(study, load[0], [a])}.",
        decide([medians[a].above(EQUAL)]),
    )  # fmt: skip
    if not others:
        return [first, _absent(q, texts[1], "stand-ins for B and C")]
    gaps = {name: estimate_difference(wide, a, name) for name in others}
    here = (
        f"Median |θ̃| of {factor_name(study.factor(load[0]))}: {_listed(medians, [a, *others])}; "
        + "; ".join(f"{a} less {name} {estimate_text(gap)}" for name, gap in gaps.items())
    )
    return [first, Finding(q, texts[1], here + ".", decide([gap.above(0) for gap in gaps.values()]))]


def _square_text(study: Study, factor: str, names: Sequence[str]) -> str:
    """What the full model says of a factor's square, which the paper's sentence is not about."""
    rows = study.surrogates[
        (study.surrogates["model"] == "full") & (study.surrogates["term"] == f"{factor}^2")
    ]
    if rows.empty:
        return ""
    wide = pivot_detectors(rows.assign(size=rows["theta_normalised"].abs()), "size")
    known = [name for name in names if name in wide.columns]
    return f"; of its square in the full model: {_listed(estimate_columns(wide), known)}"


def _least(
    question: str, text: str, wide: pd.DataFrame, names: dict[str, str], letter: str, what: str
) -> Finding:
    """Whether one stand-in has the lowest median of all."""
    if letter not in names or len(names) < 2:
        return _absent(question, text, f"a stand-in for {letter}, or another to compare it with")
    mine = names[letter]
    gaps = {name: estimate_difference(wide, name, mine) for name in names.values() if name != mine}
    here = ", ".join(f"{name} less {mine} {estimate_text(gap)}" for name, gap in gaps.items())
    here = f"Difference of {what}: {here}."
    return Finding(question, text, here, decide([gap.above(0) for gap in gaps.values()]))


def _snr_finding(study: Study, names: dict[str, str]) -> Finding:
    text = "The median SNR ranks C > B > A."
    order = [names[letter] for letter in ("C", "B", "A") if letter in names]
    if len(order) < 2:
        return _absent("Q-2", text, "two of the stand-ins for A, B, C")
    wide = pivot_detectors(study.snr, "snr_exact")
    medians = estimate_columns(wide)
    gaps = [(better, worse, estimate_difference(wide, better, worse)) for better, worse in pairwise(order)]
    ranked = sorted(order, key=lambda name: -np.nan_to_num(medians[name].value, nan=-np.inf))
    differences = ", ".join(f"{one} less {other} {estimate_text(gap)}" for one, other, gap in gaps)
    here = f"{' > '.join(ranked)}: medians {_listed(medians, ranked)}; {differences}."
    return Finding("Q-2", text, here, decide([gap.above(0) for _, _, gap in gaps]))


def scope_shares(study: Study, factor: str) -> pd.DataFrame:
    """Share of the grid on which each cell passes: cells down, detectors across."""
    rows = study.exact_scope(factor)
    shares = rows.groupby(["robot", "cycle", "axis", "fda"], observed=True)["passes"].mean()
    return pivot_detectors(shares.reset_index(), "passes")


def _scope_findings(study: Study, names: dict[str, str]) -> list[Finding]:
    q = "Q-3"
    claims = (
        ("temperature", "A and C allow more temperature variation than B.", [("A", "B"), ("C", "B")]),
        ("payload_mass_error", "C is the least affected by payload disturbances.", [("C", "A"), ("C", "B")]),
    )
    found = []
    for kind, text, pairs in claims:
        known = [name for name in study.factors_of(kind) if (study.scope["factor"] == name).any()]
        asked = [(names[one], names[other]) for one, other in pairs if {one, other} <= set(names)]
        if not known or not asked:
            found.append(_absent(q, text, "a scope of that factor, or the stand-ins to compare"))
            continue
        wide = scope_shares(study, known[0]) * 100.0
        means = estimate_columns(wide, nan_mean)
        gaps = [estimate_difference(wide, one, other, nan_mean) for one, other in asked]
        shown = list(dict.fromkeys(name for pair in asked for name in pair))
        here = (
            f"Share of the grid of {factor_name(study.factor(known[0]))} that passes: "
            f"{_listed(means, shown, '%')}; "
            + ", ".join(
                f"{one} less {other} {estimate_text(gap, 'points')}"
                for (one, other), gap in zip(asked, gaps, strict=True)
            )
        )
        found.append(Finding(q, text, here + ".", decide([gap.above(0) for gap in gaps])))
    return found


def _fit_findings(study: Study, names: dict[str, str]) -> list[Finding]:
    q = "Surrogates"
    found = []
    rows = study.validation[study.validation["fda"].isin(list(names.values()))]
    for model, (low, high) in TABLE_4.items():
        text = f"The {model} model fits {low:g} to {high:g} % (Table 4, one robot and test-cycle)."
        fits = rows.loc[rows["model"] == model, "fit"].to_numpy(dtype=float)
        good = fits[~np.isnan(fits)]
        if not good.size:
            found.append(_absent(q, text, f"the fit of a {model} model for any stand-in of A, B, C"))
            continue
        inside = int(((good >= low) & (good <= high)).sum())
        median = float(np.median(good))
        missing = f", {count_text(len(fits) - good.size, 'cell')} n/a" if len(fits) > good.size else ""
        here = (
            f"{format_number(float(good.min()))} to {format_number(float(good.max()))} %, median "
            f"{format_number(median)} % over {count_text(good.size, 'cell')}{missing}; {inside} in the "
            "paper's range. Agreeing means that the median lies in it."
        )
        found.append(Finding(q, text, here, "agrees" if low <= median <= high else "disagrees"))
    text = "The full model gains most over the simplified one for B."
    if "B" not in names or len(names) < 2 or not {"full", "simplified"} <= set(rows["model"]):
        return [*found, _absent(q, text, "both models for B and for another stand-in")]
    keys = ["robot", "cycle", "axis", "fda"]
    fit = rows.set_index([*keys, "model"])["fit"].unstack("model")
    gain = pivot_detectors((fit["full"] - fit["simplified"]).rename("gain").reset_index(), "gain")
    means = estimate_columns(gain, nan_median)
    gaps = [estimate_difference(gain, names["B"], name, nan_median) for k, name in names.items() if k != "B"]
    here = f"Median gain: {_listed(means, list(names.values()), 'points')}."
    return [*found, Finding(q, text, here, decide([gap.above(0) for gap in gaps]))]
