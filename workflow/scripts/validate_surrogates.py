"""Fit (6) of every surrogate on the validation runs, its diagnostics, and the table like Table 4."""

from job import run_job
from wearscope import tables
from wearscope.surrogates.validation import fit_table, validate_surrogates

with run_job(snakemake):
    validation = validate_surrogates(
        tables.read_table(snakemake.input.test_quantities),
        tables.read_table(snakemake.input.surrogates),
        snakemake.params.max_failed_share,
    )
    robots = (rows for _, rows in validation.groupby("robot", sort=False))
    tables.join_tables(snakemake.output.validation, robots, {"fit": "%"})
    fits = fit_table(validation, tuple(snakemake.params.models))
    units = {name: "%" for name in fits.columns if name.startswith("axis_")}
    robots = (rows for _, rows in fits.groupby("robot", sort=False))
    tables.join_tables(snakemake.output.fit_table, robots, units)
