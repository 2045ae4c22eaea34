"""Computes which factors matter (Q-1)."""

from job import run_job
from screening import read_screening
from wearscope.evaluation.sensitivity import drop_idle, sensitivity_of
from wearscope.storage import tables

COLUMNS = ["robot", "cycle", "axis", "fda", "model", "term", "theta_normalised"]

with run_job(snakemake):
    given, params = snakemake.input, snakemake.params
    screening = read_screening(given.screening)
    parts = (drop_idle(part, screening, "term") for part in tables.Parts(given.surrogates, COLUMNS))
    tables.write_table(snakemake.output[0], sensitivity_of(parts, params.model, params.group_by))
