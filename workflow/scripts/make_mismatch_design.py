"""Makes the design of the runs that give the SNR on a robot that differs from its model."""

from job import run_job
from wearscope.evaluation.snr import mismatch_design
from wearscope.storage import tables

with run_job(snakemake):
    given, params, out = snakemake.input, snakemake.params, snakemake.output
    direct, nominal = tables.read_table(given.direct), tables.read_table(given.nominal)
    units = tables.read_units(given.direct)
    pairs, learnt = mismatch_design(direct, nominal, params.mismatch, params.runs)
    tables.write_table(out.pairs, pairs, units)
    tables.write_table(out.nominal, learnt, units)
