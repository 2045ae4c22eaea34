"""Two states of the code on the same cases: which were won and lost, and whether that is more than chance.

python -m benchmarks.paired BEFORE AFTER

BEFORE and AFTER are two `--out` folders of `benchmarks.board` or `benchmarks.outside`. Cases are paired by
their name. Each score is compared by McNemar's exact test on the cases that changed; these cases are listed.
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from statsmodels.stats.contingency_tables import mcnemar

from benchmarks.command import start_parser, write_heads, write_row
from wearscope.errors import InputError
from wearscope.storage.tables import read_table

SCORES: dict[str, Callable[[pd.DataFrame], pd.Series]] = {
    "exact": lambda cases: _flag(cases["exact"], 1.0),
    "no extra name": lambda cases: _flag(cases["extra"], 0.0),
    "nothing missed": lambda cases: _flag(cases["missed"], 0.0),
    "no joint falsely unexplained": lambda cases: _flag(cases["false_unexplained"], 0.0),
    "no joint's held-out error 3 % larger": lambda cases: _flag(cases["worse"], 0.0),
    "no error": lambda cases: (cases["error"] == "").astype(float),
}
"""What is right in a case: 1, 0, or NaN where it was not judged."""


def _flag(values: pd.Series, right: float) -> pd.Series:
    numbers = pd.to_numeric(values, errors="coerce").astype(float)
    return (numbers == right).astype(float).where(numbers.notna())


def compare(before: pd.DataFrame, after: pd.DataFrame) -> pd.DataFrame:
    """Cases won and lost by score.

    Parameters
    ----------
    before, after : DataFrame
        Rows of ``cases.parquet``; only cases of both are compared.

    Returns
    -------
    DataFrame
        `score`, `cases` (judged in both), `before`, `after` (right ones), `won`, `lost` (names, joined by
        blanks) and `p` (exact, two-sided; 1 where nothing changed).
    """
    shared = before.merge(after[["dataset"]], on="dataset")["dataset"]
    first, second = (table.set_index("dataset").loc[shared] for table in (before, after))
    rows = []
    for score, judge in SCORES.items():
        was, now = judge(first), judge(second)
        judged = was.notna() & now.notna()
        was, now = was[judged] == 1.0, now[judged] == 1.0
        won, lost = was.index[~was & now], was.index[was & ~now]
        p = (
            float(mcnemar([[0, len(lost)], [len(won), 0]], exact=True).pvalue)
            if len(won) + len(lost)
            else 1.0
        )
        rows.append(
            {"score": score, "cases": int(judged.sum()), "before": int(was.sum()), "after": int(now.sum()),
             "won": " ".join(won), "lost": " ".join(lost), "p": p}
        )  # fmt: skip
    return pd.DataFrame(rows)


def write_comparison(folders: Sequence[Path]) -> str:
    """The comparison of two result folders as text."""
    cases, entries = (
        [read_table(folder / f"{name}.parquet") for folder in folders] for name in ("cases", "entries")
    )
    for folder, table in zip(folders, cases, strict=True):
        if table["dataset"].duplicated().any():
            raise InputError(f"{folder / 'cases.parquet'}: a case is there twice; run each case once.")
    rows = compare(*cases)
    shared = set(cases[0]["dataset"]) & set(cases[1]["dataset"])
    if not shared:
        raise InputError(
            f"{folders[0]} and {folders[1]} have no case in common; run both with the same options."
        )
    told = cases[1].set_index("dataset")["told"]
    heads = write_heads("right in", "cases", "before", "after", "won", "lost", "p")
    lines = [f"{len(shared)} cases in both.", "", heads]
    for row in rows.itertuples():
        won, lost = len(row.won.split()), len(row.lost.split())
        lines.append(write_row(row.score, row.cases, row.before, row.after, won, lost, f"{row.p:.3g}"))
    lines += ["", *_tell_numbers(cases, entries, sorted(shared)), ""]
    for row in rows.itertuples():
        for word, names in (("won", row.won), ("lost", row.lost)):
            lines += [f"{word}, {row.score}: {told[name]}" for name in names.split()]
    return "\n".join(lines).rstrip() + "\n"


def _tell_numbers(
    cases: Sequence[pd.DataFrame], entries: Sequence[pd.DataFrame], shared: list[str]
) -> list[str]:
    """Coverage of the intervals, held-out error and processor seconds, before and after."""
    covered = []
    for table in entries:
        mine = table[table["dataset"].isin(shared)] if len(table) else table
        values = mine["covered"].dropna() if "covered" in mine else pd.Series(dtype=float)
        covered.append(f"{int(values.sum())} of {len(values)}")
    first, second = (table.set_index("dataset").loc[shared] for table in cases)
    error = (
        (second["worst_ratio"] / first["worst_ratio"]).dropna()
        if "worst_ratio" in first
        else pd.Series(dtype=float)
    )
    median = f"{float(np.median(error)):.3f}" if len(error) else "not judged"
    return [
        f"Parameters within their 95 % interval: {covered[0]} before, {covered[1]} after.",
        f"Held-out error of the worst joint, after by before: {median} in the median.",
        f"Processor seconds: {first['seconds'].sum():.0f} before, {second['seconds'].sum():.0f} after.",
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = start_parser(__doc__)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    given = parser.parse_args(arguments)
    try:
        sys.stdout.write(write_comparison([given.before, given.after]))
    except (InputError, FileNotFoundError) as problem:
        sys.stderr.write(f"{problem}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
