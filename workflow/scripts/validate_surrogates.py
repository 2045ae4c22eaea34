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
    tables.write_table(snakemake.output.validation, validation, {"fit": "%"})
    fits = fit_table(validation, tuple(snakemake.params.models))
    units = {name: "%" for name in fits.columns if name.startswith("axis_")}
    tables.write_table(snakemake.output.fit_table, fits, units)
