"""Fits the polynomial surrogates of every cell."""

from job import run_job
from wearscope.storage import tables
from wearscope.surrogates.fitting import fit_surrogates

with run_job(snakemake):
    table = fit_surrogates(
        tables.read_table(snakemake.input.test_quantities),
        snakemake.params.models,
        snakemake.params.max_failed_share,
    )
    robots = (rows for _, rows in table.groupby("robot", sort=False))
    tables.join_tables(snakemake.output[0], robots)
