"""Q-1, Q-2 and Q-3 answered in words."""

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.evaluation.scope import count_matrix
from wearscope.reporting.findings import SMALL
from wearscope.reporting.labels import (
    factor_name,
    group_columns,
    group_name,
    join_some,
    join_words,
    split_groups,
    term_factors,
    term_name,
    unit_text,
)
from wearscope.reporting.page import format_number, interval_text, say_lines
from wearscope.reporting.study import Study

HALF = 0.5
#: Largest number of terms that a sentence names.
_MOST_TERMS = 3
_WORDS = "study/answers.html"


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
    return say_lines(_WORDS, "relevant", found, quiet, f"{SMALL:g}")


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
        return say_lines(_WORDS, "ranking", None)
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
    return say_lines(_WORDS, "ranking", told, unknown, study.snr["status"].value_counts().to_dict())


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


def effective_scope(study: Study) -> list[Markup]:
    """Answer to Q-3: on what share of the grid, by factor that varies, then how much the best tolerates."""
    groups = [(name, tolerances(study, name)) for name in study.config["scope"]["factors"]]
    told = [_describe_scope(study, name, found) for name, found in groups if found]
    detected, false = (f"{100 * study.config['scope'][name]:g}" for name in ("p_d", "p_f"))
    return say_lines(_WORDS, "scope", told, detected, false)


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
