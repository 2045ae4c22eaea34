"""The page of a reevaluation."""

from job import run_job
from reevaluated import read_reevaluation
from wearscope.reporting.reevaluation_page import render_reevaluation
from wearscope.storage import tables

with run_job(snakemake):
    given, params = snakemake.input, snakemake.params
    chosen = tables.read_table(given.chosen)
    found = read_reevaluation(given.reevaluation, given.after, params.factors, params.detectors)
    tables.write_text(snakemake.output[0], render_reevaluation(found, chosen))
