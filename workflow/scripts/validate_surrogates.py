"""Computes the fit (6) of every surrogate on the validation runs, and its diagnostics."""

from job import run_job
from wearscope.storage import tables
from wearscope.surrogates.validation import validate_surrogates

with run_job(snakemake):
    validation = validate_surrogates(
        tables.read_table(snakemake.input.test_quantities),
        tables.read_table(snakemake.input.surrogates),
        snakemake.params.max_failed_share,
    )
    robots = (rows for _, rows in validation.groupby("robot", sort=False))
    tables.join_tables(snakemake.output[0], robots, {"fit": "%"})
