"""Q-1, Q-2 and Q-3 answered in words."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from wearscope.evaluation.scope import count_matrix
from wearscope.reporting.findings import SMALL
from wearscope.reporting.labels import (
    count_text,
    factor_name,
    group_columns,
    group_name,
    join_some,
    join_words,
    split_groups,
    term_factors,
    term_name,
    unit_text,
    upper_first,
)
from wearscope.reporting.page import format_number, interval_text
from wearscope.reporting.study import Study

HALF = 0.5
#: Largest number of terms that a sentence names.
_MOST_TERMS = 3
#: Wording of an SNR's status, as said of the cells with that status.
_STATUSES = {
    "decreasing": "the test quantity falls with wear; their sign is not reversed.",
    "noise-free": "the robot's model has no noise, so there is no SNR; give its sensors some.",
    "constant": "the test quantity is always the same; they have no SNR.",
}


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


def relevant_factors(study: Study) -> list[str]:
    """Answer to Q-1: what outweighs wear by group, the detector to use first, and what hardly matters."""
    table = study.sensitivity
    by = group_columns(table)
    confirmed = _confirmed_terms(study, by)
    used = study.detector_name(study.recommended()) if study.recommended() else ""
    groups = sorted(split_groups(table, by, study.detector_names()), key=lambda one: one[0] != used)
    sentences = [_outweighing(study, name, rows, confirmed.get(name)) for name, rows in groups]
    main = table[~table["term"].str.contains(r"[:^]", regex=True) & (table["term"] != "f")]
    quiet = [
        term_name(str(term), study.factors)
        for term, rows in main.groupby("term", sort=True)
        if (rows["median_absolute"] < SMALL).all()
        and not any(term in term_factors(one) for terms in confirmed.values() for one in terms)
    ]
    if not quiet:
        return sentences
    names, verb = join_words(quiet), "matters" if len(quiet) == 1 else "matter"
    return [
        *sentences,
        f"{upper_first(names)} hardly {verb} to any of them: the median coefficient is below "
        f"{SMALL:g} of that of wear.",
    ]


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


def _outweighing(study: Study, name: str, rows: pd.DataFrame, confirmed: set[str] | None) -> str:
    cells = int(rows["n"].max())
    if cells == 0:
        return f"{name}: unknown, wear has no direct effect on the test quantity in any cell."
    strong = rows[(rows["share_relevant"] > HALF) & (rows["term"] != "f")]
    if confirmed is not None:
        second = strong["term"].str.contains(r"[:^]", regex=True)
        strong = strong[~second | strong["term"].isin(confirmed)]
    if strong.empty:
        return f"{name}: none; no term outweighs wear in more than half of the {count_text(cells, 'cell')}."
    strong = strong.sort_values(["share_relevant", "median_absolute"], ascending=False, kind="stable")
    first = strong.head(_MOST_TERMS)
    names = join_words([term_name(str(term), study.factors) for term in first["term"]])
    more = f" and {count_text(len(strong) - len(first), 'more term')}" if len(strong) > len(first) else ""
    least, most = 100 * first["share_relevant"].min(), 100 * first["share_relevant"].max()
    share = f"{least:.0f} %" if round(least) == round(most) else f"{least:.0f} to {most:.0f} %"
    verb = "disturbs" if len(strong) == 1 else "disturb"
    unsure = "" if (first["share_low"] > HALF).all() else " With so few cells, it may be less than half."
    return f"{name}: {names}{more} {verb} it more than wear, in {share} of the cells.{unsure}"


def best_detector(study: Study) -> list[str]:
    """Answer to Q-2: the ranking with intervals, ties, and the cells without an SNR or with a falling y."""
    table, out = study.ranking, [*study.withheld(), *study.upper()]
    by = group_columns(table)
    if "fda" in by:
        table = table[~table["fda"].isin(out)]
    full = study.detector_names()
    rows = [(group_name(by, [row[name] for name in by], full), row) for _, row in table.iterrows()]
    known = [(name, row) for name, row in rows if np.isfinite(row["median"])]
    if not known:
        return ["Unknown: no group has a median SNR."]
    few = "interval_from" in table and (table["interval_from"] == "each cell").any()
    best, row = known[0]
    medians = [
        f"{name} {interval_text(one['median'], one['median_low'], one['median_high'])}" for name, one in known
    ]
    source = "from each cell's own interval" if few else "over cells"
    told = f"{best} has the highest median SNR. Medians, 95 % {source}: {join_some(medians, 6)}."
    sentences = [told]
    if row["median"] <= 0:
        sentences.append("It is not positive: on the whole no detector sees the change of wear.")
    tied = [one for one in str(row["tied_with"]).split(", ") if one and one not in out]
    if tied:
        what = "The cells' own intervals leave" if few else "The choice of cells leaves"
        rivals = join_words([group_name(by, one.split("/"), full) for one in tied], "or")
        sentences.append(f"{what} open whether it beats {rivals}.")
    elif len(known) > 1 and few:
        sentences.append("Its interval lies above all others, at 95 %; other cells were not asked.")
    elif len(known) > 1:
        sentences.append("It is first in 95 % of random choices of the cells.")
    sentences += [
        f"{name}: unknown, no cell has an SNR." for name, one in rows if not np.isfinite(one["median"])
    ]
    counts = study.snr["status"].value_counts()
    cells = {status: f"In {count_text(int(n), 'cell')}" for status, n in counts.items()}
    return sentences + [f"{cells[status]} {text}" for status, text in _STATUSES.items() if status in cells]


def tolerances(study: Study, factor: str) -> list[Tolerance]:
    """Variation of a factor that half the cells of each group bear; groups with the largest share first."""
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


def effective_scope(study: Study) -> list[str]:
    """Answer to Q-3: on what share of the grid, by factor that varies, then how much the best tolerates."""
    sentences, sizes = [], []
    p_f, p_d = study.config["scope"]["p_f"], study.config["scope"]["p_d"]
    for factor in study.config["scope"]["factors"]:
        found = tolerances(study, factor)
        if not found:
            continue
        said = f"With varying {factor_name(study.factor(factor))}:"
        if found[0].share == 0:
            sentences.append(
                f"{said} none; nowhere on the grid does any cell detect "
                f"{100 * p_d:g} % of faults at {100 * p_f:g} % false alarms."
            )
            continue
        listed = join_some([f"{one.group} {100 * one.share:.0f} %" for one in found], 6)
        sentences.append(
            f"{said} {100 * p_d:g} % of faults are found at {100 * p_f:g} % false alarms, on these shares "
            f"of what was simulated: {listed}."
        )
        sizes.append(_largest_change(study, factor, found[0]))
    return [*sentences, *sizes] or ["No answer on it stands."]


def _largest_change(study: Study, factor: str, one: Tolerance) -> str:
    group = one.group
    fault, step = study.factor("f"), study.factor(factor).step
    change = f"{format_number(one.delta * fault.step, 2)} {unit_text(fault.unit)}".strip()
    if np.isnan(one.sigma):
        return (
            f"Even {group}, with a change of wear of {change}, does not reach it in half of its cells at "
            f"the smallest variation of {factor_name(study.factor(factor))} on the grid."
        )
    size = f"{format_number(one.sigma * step, 2)} {unit_text(study.factor(factor).unit)}".strip()
    end = ", the end of the grid" if one.largest else ""
    name = factor_name(study.factor(factor))
    told = f"half the cells of {group} tolerate a {name} with σ up to {size}{end}"
    return f"With a change of wear of {change}, {told}."
