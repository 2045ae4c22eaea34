"""Writes the page of a reevaluation, and replaces the earlier page and tables by the new ones."""

from pathlib import Path

from job import run_job
from reevaluated import read_reevaluation
from wearscope.reporting.reevaluation_page import render_reevaluation
from wearscope.storage import tables
from wearscope.storage.files import show_answer

with run_job(snakemake):
    given, params = snakemake.input, snakemake.params
    chosen = tables.read_table(given.chosen)
    found = read_reevaluation(given.reevaluation, given.after, params.factors, params.detectors)
    made = Path(given.reevaluation[0]).parent
    tables.write_text(made / "report.html", render_reevaluation(found, chosen))
    show_answer(made, Path(snakemake.output[0]).parent)
