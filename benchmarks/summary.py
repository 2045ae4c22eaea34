"""The board's figures: every share with its Clopper-Pearson 95 % interval, in total and by axis."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from statsmodels.stats.proportion import proportion_confint

from benchmarks.command import write_heads, write_row
from benchmarks.scoring import REPEATING, TIMES

Share = dict[str, Any]
Pick = Callable[[pd.DataFrame, pd.DataFrame], "pd.Series[Any]"]

FROM_NOTHING = ("nothing", "rigid_body", "rigid_rotor", "coulomb_only")
"""Declared sets that leave friction out."""


def tell_share(hits: "pd.Series[Any]") -> Share:
    """Share of True among values that are not missing, with its interval."""
    values = np.asarray(hits.dropna(), dtype=bool)
    count, cases = int(values.sum()), len(values)
    low, high = proportion_confint(count, cases, alpha=0.05, method="beta") if cases else (0.0, 1.0)
    low, high = (0.0 if np.isnan(low) else float(low)), (1.0 if np.isnan(high) else float(high))
    return {"share": count / cases if cases else None, "hits": count, "cases": cases, "ci95": [low, high]}


def tell_counts(hits: int, cases: int) -> str:
    """A share in words, with its interval."""
    low, high = tell_share(pd.Series([True] * hits + [False] * (cases - hits), dtype=object))["ci95"]
    return f"{hits} of {cases} ({100 * low:.0f} to {100 * high:.0f} %)"


def _planted(cases: pd.DataFrame) -> pd.DataFrame:
    return cases[~cases["null"].astype(bool)]


def _any(counts: "pd.Series[Any]") -> "pd.Series[Any]":
    return (counts > 0).where(counts.notna())


def _spread(hits: float, of: float) -> "pd.Series[Any]":
    return pd.Series([True] * int(hits) + [False] * int(of - hits), dtype=bool)


def _friction(cases: pd.DataFrame, entries: pd.DataFrame) -> "pd.Series[Any]":
    """By joint with friction that nobody declared: both named where they are findable, and nothing else."""
    chosen = entries[entries["axis_declared"].isin(FROM_NOTHING)]
    out = []
    for _, joint in chosen.groupby(["dataset", "joint"]):
        mine = joint[joint["effect"].isin(["coulomb", "viscous"]) & joint["standard"].astype(bool)]
        findable = mine[mine["times_findable"] >= TIMES]
        if findable.empty:
            continue
        others = joint[(joint["kind"] == "planted") & ~joint["standard"].astype(bool)]
        extra = joint[joint["kind"] == "extra"]
        out.append(bool((findable["grade"] == "right").all() and (extra.empty or not others.empty)))
    return pd.Series(out, dtype=bool)


def _outside(cases: pd.DataFrame, entries: pd.DataFrame) -> "pd.Series[Any]":
    findable = entries["times_findable"].astype(float) >= TIMES
    return entries.loc[entries["outside"].astype(bool) & findable, "found"]


def _refuted(cases: pd.DataFrame, entries: pd.DataFrame) -> "pd.Series[Any]":
    """By name that a verdict gives, whichever planted effects it accounts for."""
    return _spread(cases["refuted"].fillna(0).sum(), cases["statuses"].fillna(0).sum())


def _sets(cases: pd.DataFrame, entries: pd.DataFrame) -> "pd.Series[Any]":
    """By name that a verdict gives: whether it, or one in its set, is planted at its joint."""
    named = entries[entries["named_as"].fillna("").ne("") & entries["named_as"].ne("unknown")]
    holds = named["grade"].isin(["right", "equivalent"])
    return holds.groupby([named["dataset"], named["joint"], named["named_as"]], dropna=False).any()


def _unexplained(cases: pd.DataFrame, entries: pd.DataFrame) -> "pd.Series[Any]":
    """By joint of the cases whose noise does not repeat."""
    judged = cases[cases["false_unexplained"].notna()]
    return _spread(judged["false_unexplained"].sum(), judged["joints"].sum())


SCORES: dict[str, tuple[str, Pick, str]] = {
    "false_in_null": (
        "a false name or unknown in a null",
        lambda c, e: c.loc[c["null"].astype(bool), "false_in_null"], "at most 1 %",
    ),
    "exact": (
        "all and only the planted effects (those at 2 x just findable required)",
        lambda c, e: _planted(c)["exact"], "90 %",
    ),
    "required_found": (
        "required effects named, right or in the confidence set",
        lambda c, e: e.loc[e["required"].astype(bool), "found"], "",
    ),
    "extra_name": ("an extra name in a planted case", lambda c, e: _any(_planted(c)["extra"]), "2 %"),
    "extra_unknown": ("an extra unknown in a planted case", lambda c, e: _any(_planted(c)["unknowns"]), ""),
    "friction_from_nothing": (
        "undeclared Coulomb and viscous, and nothing else, by joint", _friction, "90 %",
    ),
    "false_unexplained": ("joints called unexplained where all is named", _unexplained, "at most 3 %"),
    "outside_answered": ("outside effects answered unknown or unexplained", _outside, "95 %"),
    "held_out_worse": (
        "held-out error of a joint larger by more than 3 %",
        lambda c, e: c.loc[c["error"] == "", "worse"], "0.5 %",
    ),
    "refuted": ("names that the test runs refute", _refuted, "1 %"),
    "set_holds_truth": (
        "a name, or one of its equivalents, is planted at its joint", _sets, "88 to 98 %",
    ),
    "parameter_covered": ("parameter within its 95 % interval", lambda c, e: _any(e["covered"]), ""),
    "failed": ("cases that ended in an error or at the time limit", lambda c, e: c["error"] != "", ""),
}  # fmt: skip
"""Scores: words, how their cases are picked, and what is to be reached."""
CASE_COLUMNS = (
    "false_in_null", "extra", "unknowns", "refuted", "statuses", "false_unexplained", "joints", "worse",
)  # fmt: skip
ENTRY_COLUMNS = (
    "dataset", "kind", "effect", "joint", "outside", "standard", "required", "found", "grade", "named_as",
    "covered", "times_findable", "axis_declared",
)  # fmt: skip
"""What is missing where every case failed, or none had an entry."""
FEWEST_BINNED = 12
"""Different values from which on an axis of numbers is told in bins."""
BY_AXIS = ("exact", "false_in_null", "extra_name", "required_found")


def bin_axes(table: pd.DataFrame) -> pd.DataFrame:
    """Levels of every axis by row: names as they are, many numbers in three bins even in the logarithm."""
    out = pd.DataFrame(index=table.index)
    for column in table:
        if not str(column).startswith("axis_"):
            continue
        values, name = table[column], str(column).removeprefix("axis_")
        if not pd.api.types.is_float_dtype(values):
            out[name] = values.astype(str)
            continue
        if values.nunique() < FEWEST_BINNED or not (values > 0).all():
            out[name] = [f"{value:.3g}" for value in values]
            continue
        edges = np.geomspace(values.min(), values.max(), 4)
        labels = [f"{low:.3g} to {high:.3g}" for low, high in pairwise(edges)]
        out[name] = [labels[k] for k in np.clip(np.searchsorted(edges, values, side="right") - 1, 0, 2)]
    return out


def summarise(cases: pd.DataFrame, entries: pd.DataFrame) -> dict[str, Any]:
    """Figures of the cases of a run.

    Parameters
    ----------
    cases, entries : DataFrame
        As `runner.run_cases` writes them.

    Returns
    -------
    dict
        `cases`, `seconds` of processor (median and largest), `total` (by score: `share`, `hits`, `cases`,
        `ci95`),
        `axes` (by axis and level, the same for the scores of `BY_AXIS`), `repeating_nulls` (nulls with hum
        or events, which may be `unexplained`), `errors` (the messages, counted).
    """
    cases = cases.reindex(columns=list(dict.fromkeys([*cases, *CASE_COLUMNS])))
    entries = entries.reindex(columns=list(dict.fromkeys([*entries, *ENTRY_COLUMNS])))
    levels, entry_levels = bin_axes(cases), bin_axes(entries)
    axes: dict[str, Any] = {}
    for axis in levels:
        axes[axis] = {}
        for level in sorted(levels[axis].unique()):
            part = cases[levels[axis] == level]
            own = entries[entry_levels[axis] == level] if len(entries) else entries
            axes[axis][level] = {key: tell_share(SCORES[key][1](part, own)) for key in BY_AXIS}
    nulls = cases[cases["null"].astype(bool)]
    repeating = nulls[nulls["axis_noise"].isin(REPEATING)]
    errors = cases.loc[cases["error"] != "", "error"].value_counts()
    return {
        "cases": len(cases),
        "seconds": {"median": float(cases["seconds"].median()), "largest": float(cases["seconds"].max())},
        "total": {key: tell_share(pick(cases, entries)) for key, (_, pick, _) in SCORES.items()},
        "repeating_nulls": tell_share(repeating["false_in_null"]),
        "axes": axes,
        "errors": {str(error): int(count) for error, count in errors.items()},
    }


def _words(share: Share) -> str:
    if not share["cases"]:
        return "-"
    low, high = share["ci95"]
    counts = f"{share['hits']}/{share['cases']}; {100 * low:.0f} to {100 * high:.0f}"
    return f"{100 * share['share']:.1f} % ({counts})"


def _badness(levels: dict[str, Any]) -> float:
    """How far an axis's worst level lies from its best in exact cases, one of either kind added to each."""
    shares = [
        (x["exact"]["hits"] + 1) / (x["exact"]["cases"] + 2) for x in levels.values() if x["exact"]["cases"]
    ]
    return max(shares) - min(shares) if len(shares) > 1 else 0.0


def write_markdown(summary: dict[str, Any]) -> str:
    """The board's figures as Markdown: the scores in total, then by axis, the worst axis first."""
    seconds = summary["seconds"]
    lines = [
        f"{summary['cases']} cases, {seconds['median']:.0f} processor seconds in the median, "
        f"{seconds['largest']:.0f} s at most.",
        "",
        write_heads("score", "measured (hits/cases; 95 % interval)", "to reach"),
    ]
    for key, (words, _, target) in SCORES.items():
        lines.append(write_row(words, _words(summary["total"][key]), target))
    lines.append(write_row("of the nulls, those with hum or events", _words(summary["repeating_nulls"]), ""))
    lines += ["", write_heads("axis", "level", *BY_AXIS)]
    for axis, levels in sorted(summary["axes"].items(), key=lambda item: -_badness(item[1])):
        for level, shares in sorted(
            levels.items(),
            key=lambda item: (item[1]["exact"]["share"] is None, item[1]["exact"]["share"] or 0.0),
        ):
            lines.append(write_row(axis, level, *(_words(shares[key]) for key in BY_AXIS)))
    if summary["errors"]:
        lines += ["", write_heads("error", "cases")]
        lines += [
            write_row(error.replace("|", "/")[:160], count) for error, count in summary["errors"].items()
        ]
    return "\n".join(lines) + "\n"
