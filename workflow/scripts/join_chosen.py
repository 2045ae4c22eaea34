"""Joins the tables of chosen surrogates into one."""

import pandas as pd

from job import run_job
from wearscope.storage import tables

with run_job(snakemake) as say:
    parts = [tables.read_table(part) for part in snakemake.input.parts]
    table = pd.concat(parts, ignore_index=True)
    fits = table["fit"].dropna()
    say(f"fit on the checking runs {fits.median():.1f} % in the median, {fits.min():.1f} % at worst")
    for state, rows in table.groupby("state"):
        say(f"{len(rows)} cells: {state}")
    tables.write_table(snakemake.output[0], table, dict.fromkeys(["fit", "ceiling", "ceiling_low"], "%"))
