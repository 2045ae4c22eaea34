"""Surrogates of every cell."""

from job import run_job
from wearscope import tables
from wearscope.surrogates.fitting import fit_surrogates

with run_job(snakemake):
    table = fit_surrogates(
        tables.read_table(snakemake.input.test_quantities),
        snakemake.params.models,
        snakemake.params.max_failed_share,
    )
    tables.write_table(snakemake.output[0], table)
