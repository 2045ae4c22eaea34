"""What the stages of a study cost, from the timings that Snakemake keeps."""

import csv
from pathlib import Path

import pandas as pd


def read_costs(folder: str | Path) -> pd.DataFrame:
    """Sum of the timings of every rule.

    Parameters
    ----------
    folder : path-like
        Holds ``<rule>.tsv`` and ``<rule>/**/*.tsv`` as every job writes them (`workflow/scripts/job.py`).

    Returns
    -------
    DataFrame
        ``stage`` (the rule), ``jobs``, ``seconds`` (sum over jobs), ``memory`` [MiB] (of the largest job).
        Files that hold no timing are left out.
    """
    folder = Path(folder)
    totals: dict[str, list[float]] = {}
    for file in sorted(folder.rglob("*.tsv")):
        with open(file, encoding="utf-8", newline="") as stream:
            for row in csv.DictReader(stream, delimiter="\t"):
                seconds = _number(row.get("s"))
                if seconds is None:
                    continue
                stage = file.relative_to(folder).parts[0].removesuffix(".tsv")
                one = totals.setdefault(stage, [0.0, 0.0, 0.0])
                one[0] += 1
                one[1] += seconds
                one[2] = max(one[2], _number(row.get("max_rss")) or 0.0)
    records = [(stage, int(one[0]), one[1], one[2]) for stage, one in totals.items()]
    return pd.DataFrame(records, columns=["stage", "jobs", "seconds", "memory"])


def _number(text: str | None) -> float | None:
    try:
        return float(text or "")
    except ValueError:
        return None
