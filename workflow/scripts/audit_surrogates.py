"""Surrogate against direct simulation: both values, how often the interval held, verdicts."""

import pandas as pd

from job import run_job
from wearscope import tables
from wearscope.evaluation.audit import audit_summary, audit_table, audit_verdicts

with run_job(snakemake) as say:
    direct = pd.concat([tables.read_table(part) for part in snakemake.input.parts], ignore_index=True)
    points = tables.read_table(snakemake.input.points)
    surrogates = tables.read_table(snakemake.input.surrogates)
    table = audit_table(direct, surrogates, points, snakemake.params.model)
    say(f"the prediction interval held {int(table['inside'].sum())} of {len(table)} direct values")
    tables.write_table(snakemake.output.audit, table)
    tables.write_table(snakemake.output.summary, audit_summary(table, snakemake.params.group_by))
    tables.write_table(snakemake.output.verdicts, audit_verdicts(table))
