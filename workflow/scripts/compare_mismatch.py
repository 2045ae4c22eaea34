"""Compares the SNR on a robot that differs from its model with that on a robot that does not."""

from job import run_job
from wearscope.evaluation.snr import mismatch_table
from wearscope.storage import tables

with run_job(snakemake) as say:
    given = snakemake.input
    quantities, direct = tables.read_table(given.quantities), tables.read_table(given.direct)
    table = mismatch_table(quantities, direct, snakemake.params.seed)
    for row in table.itertuples():
        say(f"fda {row.fda}: SNR {row.snr_ideal:.3g} on its model, {row.snr_mismatch:.3g} where it differs")
    tables.write_table(snakemake.output[0], table)
