"""Which factors matter (Q-1)."""

from job import run_job
from screening import read_screening
from wearscope import tables
from wearscope.evaluation.sensitivity import sensitivity_table
from wearscope.simulation.screening import drop_idle

with run_job(snakemake):
    given, params = snakemake.input, snakemake.params
    surrogates = drop_idle(tables.read_table(given.surrogates), read_screening(given.screening), "term")
    table = sensitivity_table(surrogates, params.model, params.group_by)
    tables.write_table(snakemake.output[0], table)
