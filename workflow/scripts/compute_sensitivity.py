"""Which factors matter (Q-1)."""

from job import run_job
from wearscope import tables
from wearscope.evaluation.sensitivity import sensitivity_table

with run_job(snakemake):
    table = sensitivity_table(
        tables.read_table(snakemake.input.surrogates), snakemake.params.model, snakemake.params.group_by
    )
    tables.write_table(snakemake.output[0], table)
