"""The board's tables from its rows: confusion matrix, rates with their bounds, smallest named size."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import beta

NAMED_SHARE = 0.8
"""An effect counts as named at a size where this share of its cases is answered right or equivalent."""


def bound_share(hits: int, cases: int, level: float = 0.95) -> tuple[float, float]:
    """Clopper-Pearson interval of a share (two-sided); (0, 1) where there is no case."""
    if cases == 0:
        return 0.0, 1.0
    tail = (1 - level) / 2
    low = 0.0 if hits == 0 else float(beta.ppf(tail, hits, cases - hits + 1))
    high = 1.0 if hits == cases else float(beta.ppf(1 - tail, hits + 1, cases - hits))
    return low, high


def upper_bound(hits: int, cases: int, level: float = 0.95) -> float:
    """One-sided Clopper-Pearson upper bound of a share; 1 where there is no case."""
    return 1.0 if cases == 0 or hits == cases else float(beta.ppf(level, hits + 1, cases - hits))


def _share(hits: Sequence[bool] | pd.Series) -> dict[str, Any]:
    values = np.asarray(hits, dtype=bool)
    count, cases = int(values.sum()), len(values)
    low, high = bound_share(count, cases)
    return {
        "share": count / cases if cases else None,
        "hits": count,
        "cases": cases,
        "ci95": [low, high],
        "upper95": upper_bound(count, cases),
    }


def tabulate_confusion(rows: pd.DataFrame) -> pd.DataFrame:
    """Confusion matrix in long form: `method`, `truth`, `answer`, `count`.

    `truth` is the planted effect, ``null:<noise>`` or ``outside:<name>``; `answer` the named effect where it
    is right or wrong, else ``none``, ``unknown`` or ``equivalent``.
    """
    frame = rows.copy()
    frame["truth"] = np.where(
        frame["kind"] == "null",
        "null:" + frame["noise"],
        np.where(frame["outside"].astype(bool), "outside:", "") + frame["effect"],
    )
    plain = frame["outcome"].isin(["none", "unknown", "equivalent", "error"])
    frame["answer"] = np.where(plain, frame["outcome"], frame["named"])
    counted = frame.groupby(["method", "truth", "answer"], sort=True).size()
    return counted.reset_index(name="count")


def find_smallest_sizes(rows: pd.DataFrame) -> pd.DataFrame:
    """Smallest planted size from which on every size of an effect is named in 80 % of its cases.

    Columns `method`, `effect`, `smallest_size` (NaN where none is), `cases`, over single named effects.
    """
    single = rows[(rows["kind"] == "single") & ~rows["outside"].astype(bool)]
    out = []
    for (method, effect), group in single.groupby(["method", "effect"], sort=True):
        shares = group.groupby("size")["correct"].mean().sort_index(ascending=False)
        smallest = np.nan
        for size, share in shares.items():
            if share < NAMED_SHARE:
                break
            smallest = float(size)  # type: ignore[arg-type]
        out.append({"method": method, "effect": effect, "smallest_size": smallest, "cases": len(group)})
    return pd.DataFrame(out, columns=["method", "effect", "smallest_size", "cases"])


def summarise(rows: pd.DataFrame) -> dict[str, Any]:
    """Figures of the board by method, each share with its count and its 95 % bounds.

    Returns
    -------
    dict
        By method: `named` (shares right at the first place by size, among separable single effects: strict,
        and with equivalent answers), `named_all` (the same over all), `wrong_name` (planted cases with any
        entry that nothing planted accounts for), `false_attribution` (nulls with a non-empty verdict;
        `..._named` counts named effects only; by noise), `outside_unknown`, `coverage`, `parameter_error`
        (absolute, quartiles), `gap_closure` (quartiles), `pairs` (both found, at least one), `errors`.
    """
    result: dict[str, Any] = {}
    for method, frame in rows.groupby("method", sort=True):
        outside = frame["outside"].astype(bool)
        null = frame[frame["kind"] == "null"]
        single = frame[(frame["kind"] == "single") & ~outside]
        planted = frame[frame["kind"] != "null"].drop_duplicates("dataset")
        outer = frame[(frame["kind"] == "single") & outside]
        separable = single[single["separable"].astype(bool)]
        pairs = frame[frame["kind"] == "pair"]
        found = pairs.groupby("dataset")["correct"].agg(["all", "any"])
        covered = frame["covered"].dropna()
        closed = frame.loc[frame["correct"].astype(bool), "gap_closure"].dropna()
        every = frame.loc[(frame["kind"] != "null"), "gap_closure"].dropna()
        result[str(method)] = {
            "cases": int(frame["dataset"].nunique()),
            "errors": int((frame["outcome"] == "error").sum()),
            "named": _by_size(separable),
            "named_all": _by_size(single),
            "wrong_name": _share(planted["extra_named"] > 0),
            "false_attribution": _share(null["outcome"].isin(["wrong", "unknown", "error"])),
            "false_attribution_named": _share(null["outcome"] == "wrong"),
            "false_attribution_by_noise": {
                str(kind): _share(group["outcome"].isin(["wrong", "unknown", "error"]))
                for kind, group in null.groupby("noise", sort=True)
            },
            "outside_unknown": _share(outer.loc[outer["separable"].astype(bool), "correct"]),
            "outside_unknown_all": _share(outer["correct"]),
            "coverage": _share(covered > 0.5),
            "parameter_error": _quartiles(frame["parameter_error"].dropna().abs()),
            "gap_closure": _quartiles(closed),
            "gap_closure_all": _quartiles(every),
            "gap_closed_90": _share(every >= 0.9),
            "pairs": {"both": _share(found["all"]), "any": _share(found["any"])},
        }
    return result


def _by_size(frame: pd.DataFrame) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for size, group in frame.groupby("size", sort=True):
        strict = (group["outcome"] == "right") & group["first"].astype(bool)
        loose = group["correct"].astype(bool) & group["first"].astype(bool)
        out[f"{size:g}"] = {"right": _share(strict), "right_or_equivalent": _share(loose)}
    large = frame[frame["size"] >= 4]
    loose = large["correct"].astype(bool) & large["first"].astype(bool)
    strict = (large["outcome"] == "right") & large["first"].astype(bool)
    out["4 and more"] = {"right": _share(strict), "right_or_equivalent": _share(loose)}
    return out


def _quartiles(values: pd.Series) -> dict[str, Any]:
    if values.empty:
        return {"cases": 0, "quartiles": None}
    return {"cases": len(values), "quartiles": [float(x) for x in np.quantile(values, [0.25, 0.5, 0.75])]}


def _tell(share: dict[str, Any]) -> str:
    if share["cases"] == 0:
        return "-"
    low, high = share["ci95"]
    counts = f"{share['hits']}/{share['cases']}; {100 * low:.0f} to {100 * high:.0f}"
    return f"{100 * share['share']:.1f} % ({counts})"


def write_markdown(summary: dict[str, Any], sizes: pd.DataFrame) -> str:
    """The board's figures as Markdown: one table of rates by method, one of smallest named sizes."""
    methods = list(summary)
    lines = ["| figure | " + " | ".join(methods) + " |", "|---|" + "---|" * len(methods)]

    def add(label: str, tell: Any) -> None:
        lines.append(f"| {label} | " + " | ".join(tell(summary[m]) for m in methods) + " |")

    def quartiles(entry: dict[str, Any]) -> str:
        if entry["quartiles"] is None:
            return "-"
        return " / ".join(f"{x:.3f}" for x in entry["quartiles"]) + f" ({entry['cases']})"

    def by_size(key: str, size: str) -> Any:
        return lambda s: _tell(s[key][size]["right_or_equivalent"]) if size in s[key] else "-"

    for size in sorted({k for m in methods for k in summary[m]["named_all"] if k != "4 and more"}, key=float):
        add(f"named, separable, size {size}", by_size("named", size))
        add(f"named, all, size {size}", by_size("named_all", size))
    add("named, separable, size 4 and more", by_size("named", "4 and more"))
    add(
        "the same, without equivalents",
        lambda s: _tell(s["named"]["4 and more"]["right"]),
    )
    add("wrong name in a planted case", lambda s: _tell(s["wrong_name"]))
    add("false attribution on nulls (anything said)", lambda s: _tell(s["false_attribution"]))
    add("its one-sided 95 % upper bound", lambda s: f"{100 * s['false_attribution']['upper95']:.2f} %")
    add("false attribution on nulls (a name)", lambda s: _tell(s["false_attribution_named"]))
    add("outside effects answered unknown", lambda s: _tell(s["outside_unknown"]))
    add("parameter within its 95 % interval", lambda s: _tell(s["coverage"]))
    add("parameter error, absolute, quartiles", lambda s: quartiles(s["parameter_error"]))
    add("gap closed, planted, quartiles", lambda s: quartiles(s["gap_closure_all"]))
    add("gap closed by 90 % or more", lambda s: _tell(s["gap_closed_90"]))
    add("pairs: both found", lambda s: _tell(s["pairs"]["both"]))
    add("cases that ended in an error", lambda s: str(s["errors"]))
    wide = sizes.pivot(index="effect", columns="method", values="smallest_size") if len(sizes) else sizes
    lines += ["", "| smallest size named | " + " | ".join(methods) + " |", "|---|" + "---|" * len(methods)]
    for effect in wide.index if len(sizes) else []:
        cells = [wide.loc[effect].get(m, np.nan) for m in methods]
        lines.append(f"| {effect} | " + " | ".join("-" if pd.isna(c) else f"{c:g}" for c in cells) + " |")
    return "\n".join(lines) + "\n"
