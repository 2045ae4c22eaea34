"""Writes the page of a tracked machine."""

from pathlib import Path

from job import run_job
from wearscope.reporting.tracking_page import write_tracking_page

with run_job(snakemake):
    write_tracking_page(Path(snakemake.output[0]).parent)
