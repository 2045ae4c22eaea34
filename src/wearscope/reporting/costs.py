"""What the stages of a study cost, from the timings that Snakemake keeps."""

from contextlib import suppress
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
    parts = [pd.DataFrame(columns=["stage", "s", "max_rss"])]
    for file in sorted(Path(folder).rglob("*.tsv")):
        stage = file.relative_to(folder).parts[0].removesuffix(".tsv")
        with suppress(pd.errors.EmptyDataError):
            parts.append(pd.read_csv(file, sep="\t").reindex(columns=["s", "max_rss"]).assign(stage=stage))
    jobs = pd.concat([part for part in parts if len(part)] or parts, ignore_index=True)
    jobs = jobs.assign(s=pd.to_numeric(jobs["s"], "coerce"), max_rss=pd.to_numeric(jobs["max_rss"], "coerce"))
    by = jobs[jobs["s"].notna()].fillna({"max_rss": 0.0}).groupby("stage", sort=False)
    return by.agg(jobs=("s", "size"), seconds=("s", "sum"), memory=("max_rss", "max")).reset_index()
