"""The page of a closed loop."""

from pathlib import Path

from job import run_job
from wearscope.reporting.closed_loop_page import write_closed_loop_page

with run_job(snakemake):
    write_closed_loop_page(Path(snakemake.output[0]).parent)
