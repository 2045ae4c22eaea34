"""Chooses the surrogate of every cell of one robot, or of all models of a reevaluation."""

import pandas as pd

from job import run_job
from wearscope.designs.factors import Factor
from wearscope.storage import tables
from wearscope.surrogates.chosen import choose_surrogates

with run_job(snakemake) as say:
    params = snakemake.params
    factors = [Factor(**one) for one in params.factors]
    parts = []
    for part in tables.Parts(snakemake.input.test_quantities):
        parts.append(choose_surrogates(part, factors, params.kinds, params.goal, params.max_failed_share))
    table = pd.concat(parts, ignore_index=True)
    for state, rows in table.groupby("state"):
        say(f"{len(rows)} of {len(table)} cells: {state}")
    tables.write_table(snakemake.output[0], table, dict.fromkeys(["fit", "ceiling", "ceiling_low"], "%"))
