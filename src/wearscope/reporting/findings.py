"""The paper's findings and this study's, line by line; every sentence is made from the tables."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from wearscope.evaluation.grouping import (
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

PAPER_MODULES = {"A": "residual_energy", "B": "distribution_distance", "C": "friction_fit"}
"""Modules that replace the paper's confidential detectors."""
LARGE, EQUAL, SMALL = 0.5, 1.0, 0.25
"""Median |normalised coefficient| that counts as considerable, as much as wear, and insignificant."""
FEW_CELLS = "This study has too few cells for an interval."
TABLE_4 = {"full": (83.7, 95.0), "simplified": (64.6, 89.8)}


@dataclass(frozen=True)
class Finding:
    """One line of the comparison: what the paper says, and what this study's tables say with intervals.

    The verdict is agrees, partly, disagrees, undecided (the intervals leave it open), or not asked (the study
    lacks the detectors or factors, or has too few cells for an interval).
    """

    question: str
    paper: str
    here: str
    verdict: str


def compare_with_paper(study: Study) -> list[Finding]:
    """Findings of the paper's Secs. 6.1 to 6.4, each compared with this study's own tables.

    Intervals (95 %) are over the choice of cells: combinations of robot, test-cycle and axis are resampled,
    the same ones for all detectors.
    """
    names = {
        letter: name
        for letter, module in PAPER_MODULES.items()
        if (name := study.detector_of(module)) is not None
    }
    warm, load = "temperature", "payload_mass_error"
    tells = [
        (warm, "Temperature considerably affects every detector.", "ABC", (), LARGE),
        (warm, "C has the lowest median coefficient of temperature.", "ABC", ("AC", "BC"), None),
        (load, "Payload mass error moves A more than wear does.", "A", (), EQUAL),
        (load, "B and C respond less to payload mass error than A.", "ABC", ("AB", "AC"), None),
    ]
    scopes = [
        (warm, "A and C allow more temperature variation than B.", ("AB", "CB")),
        (load, "C is the least affected by payload disturbances.", ("CA", "CB")),
    ]
    return [
        *_fit_findings(study, names),
        *(_coefficient_finding(study, names, *one) for one in tells),
        _quiet_finding(study, names),
        _snr_finding(study, names),
        *(_scope_finding(study, names, *one) for one in scopes),
    ]


def findings_table(findings: Sequence[Finding]) -> pd.DataFrame:
    """``question``, ``paper``, ``here``, ``verdict``."""
    return pd.DataFrame([asdict(one) for one in findings], columns=["question", "paper", "here", "verdict"])


def read_findings(table: pd.DataFrame) -> list[Finding]:
    """The inverse of `findings_table`."""
    return [Finding(*(str(value) for value in row)) for row in table.itertuples(index=False)]


def estimate_text(one: Estimate, unit: str = "") -> str:
    """``2.1 (1.8 to 2.5)`` with unit; ``2.1`` where there is no interval, n/a where the value is unknown."""
    if np.isnan(one.value):
        return "n/a"
    told = f"{format_number(one.value)}{f' {unit}' if unit else ''}"
    if np.isnan(one.low):
        return told
    return f"{told} ({format_number(one.low)} to {format_number(one.high)})"


def _listed(estimates: dict[str, Estimate], names: Sequence[str], unit: str = "") -> str:
    return ", ".join(f"{name} {estimate_text(estimates[name], unit)}" for name in names)


def _are_few(estimates: Iterable[Estimate]) -> bool:
    """Whether some estimate has too few cells for an interval."""
    return any(np.isfinite(one.value) and np.isnan(one.low) for one in estimates)


def _absent(
    question: str, paper: str, why: str = "This study lacks the detectors or the factor for it."
) -> Finding:
    return Finding(question, paper, why, "not asked")


def _judge(
    question: str, paper: str, what: str, wide: pd.DataFrame, shown: Sequence[str],
    pairs: Sequence[tuple[str, str]] = (), limit: float | None = None,
    statistic: Callable[[np.ndarray], np.ndarray] = nan_median,
    units: tuple[str, str] = ("", ""), note: str = "",
) -> Finding:  # fmt: skip
    """Finding that a quantity exceeds a limit at each detector, or is larger at the first one of a pair.

    `units` are those of the quantity and of its differences.
    """
    known = estimate_columns(wide, statistic)
    gaps = [(f"{one} less {other}", estimate_difference(wide, one, other, statistic)) for one, other in pairs]
    outcomes = [gap.above(0) for _, gap in gaps]
    outcomes += [known[name].above(limit) for name in shown] if limit is not None else []
    told = [f"{what}: {_listed(known, shown, units[0])}{note}"]
    told += [f"{name} {estimate_text(gap, units[1])}" for name, gap in gaps]
    if _are_few([*(known[name] for name in shown), *(gap for _, gap in gaps)]):
        return _absent(question, paper, FEW_CELLS)
    return Finding(question, paper, f"{'; '.join(told)}.", decide(outcomes))


def _pairs(names: dict[str, str], pairs: Sequence[str]) -> list[tuple[str, str]]:
    """Names of the detectors of each pair of letters, where the study has both."""
    return [(names[pair[0]], names[pair[1]]) for pair in pairs if set(pair) <= set(names)]


def coefficients(study: Study, term: str, model: str = "") -> pd.DataFrame:
    """Magnitude of a term's normalised coefficient (8): cells down, detectors across."""
    model = model or study.config["sensitivity"]["model"]
    rows = study.surrogates[(study.surrogates["model"] == model) & (study.surrogates["term"] == term)]
    wide = pivot_detectors(rows.assign(size=rows["theta_normalised"].abs()), "size")
    return wide.replace([np.inf], np.nan)


def _coefficient_finding(
    study: Study,
    names: dict[str, str],
    kind: str,
    paper: str,
    letters: str,
    pairs: Sequence[str],
    limit: float | None,
) -> Finding:
    factors, asked = study.factors_of(kind), _pairs(names, pairs)
    shown = [names[letter] for letter in letters if letter in names]
    if not factors or not shown or (pairs and not asked):
        return _absent("Q-1", paper)
    what, note = f"Median |θ̃| of {factor_name(study.factor(factors[0]))}", ""
    if limit is not None:
        # The paper's sentence is not about the square, which the full model has.
        square = coefficients(study, f"{factors[0]}^2", "full")
        known = [name for name in shown if name in square]
        note = f"; of its square: {_listed(estimate_columns(square), known)}" if known else ""
        note += f"; considerable from {limit:g}" if limit == LARGE else f"; as much as wear is {limit:g}"
    return _judge("Q-1", paper, what, coefficients(study, factors[0]), shown, asked, limit, note=note)


def _quiet_finding(study: Study, names: dict[str, str]) -> Finding:
    paper = "Wear of the other joints and point-to-point delay are insignificant for every detector."
    quiet = [*study.factors_of("wear"), *study.factors_of("dwell")]
    if not quiet or not names:
        return _absent("Q-1", paper)
    medians = {one: estimate_columns(coefficients(study, one)) for one in quiet}
    parts = [
        f"{factor_name(study.factor(one))}: {_listed(known, list(names.values()))}"
        for one, known in medians.items()
    ]
    here = f"Median |θ̃| of {'; '.join(parts)}; insignificant up to {SMALL:g}."
    if _are_few(one[name] for one in medians.values() for name in names.values()):
        return _absent("Q-1", paper, FEW_CELLS)
    outcomes = [known[name].below(SMALL) for known in medians.values() for name in names.values()]
    return Finding("Q-1", paper, here, decide(outcomes))


def _snr_finding(study: Study, names: dict[str, str]) -> Finding:
    paper = "The median SNR ranks C > B > A."
    order = [names[letter] for letter in "CBA" if letter in names]
    if len(order) < 2:
        return _absent("Q-2", paper)
    wide = pivot_detectors(study.snr, "snr_exact")
    medians = estimate_columns(wide)
    ranked = sorted(order, key=lambda name: -np.nan_to_num(medians[name].value, nan=-np.inf))
    return _judge("Q-2", paper, f"{' > '.join(ranked)}, medians", wide, ranked, list(pairwise(order)))


def _scope_finding(
    study: Study, names: dict[str, str], kind: str, paper: str, pairs: Sequence[str]
) -> Finding:
    known = [name for name in study.factors_of(kind) if (study.scope["factor"] == name).any()]
    asked = _pairs(names, pairs)
    if not known or not asked:
        return _absent("Q-3", paper)
    what = f"Share of the grid of {factor_name(study.factor(known[0]))} that passes"
    shown = list(dict.fromkeys(name for pair in asked for name in pair))
    wide = 100.0 * scope_shares(study, known[0])
    return _judge("Q-3", paper, what, wide, shown, asked, None, nan_mean, ("%", "points"))


def scope_shares(study: Study, factor: str) -> pd.DataFrame:
    """Share of the grid on which each cell passes: cells down, detectors across."""
    rows = study.exact_scope(factor)
    shares = rows.groupby(["robot", "cycle", "axis", "fda"], observed=True)["passes"].mean()
    return pivot_detectors(shares.reset_index(), "passes")


def _fit_findings(study: Study, names: dict[str, str]) -> list[Finding]:
    q, found = "Surrogates", []
    rows = study.validation[study.validation["fda"].isin(list(names.values()))]
    for model, (low, high) in TABLE_4.items():
        paper = f"The {model} model fits {low:g} to {high:g} % (Table 4, one robot and test-cycle)."
        fits = rows.loc[rows["model"] == model, "fit"].to_numpy(dtype=float)
        good = fits[~np.isnan(fits)]
        if not good.size:
            found.append(_absent(q, paper))
            continue
        inside = int(((good >= low) & (good <= high)).sum())
        median = float(np.median(good))
        missing = f", {count_text(len(fits) - good.size, 'cell')} n/a" if len(fits) > good.size else ""
        here = (
            f"{format_number(float(good.min()))} to {format_number(float(good.max()))} %, median "
            f"{format_number(median)} % over {count_text(good.size, 'cell')}{missing}; {inside} in the "
            "paper's range. Agreeing means that the median lies in it."
        )
        found.append(Finding(q, paper, here, "agrees" if low <= median <= high else "disagrees"))
    paper = "The full model gains most over the simplified one for B."
    pairs = _pairs(names, ("BA", "BC"))
    if not pairs or not {"full", "simplified"} <= set(rows["model"]):
        return [*found, _absent(q, paper)]
    fit = rows.set_index(["robot", "cycle", "axis", "fda", "model"])["fit"].unstack("model")
    gain = pivot_detectors((fit["full"] - fit["simplified"]).rename("gain").reset_index(), "gain")
    units = ("points", "points")
    return [*found, _judge(q, paper, "Median gain", gain, list(names.values()), pairs, units=units)]
