"""Writes the page on detectors applied to recordings."""

from pathlib import Path

from job import run_job
from wearscope.reporting.detection_page import write_detection_page

with run_job(snakemake):
    write_detection_page(Path(snakemake.output[0]).parent)
