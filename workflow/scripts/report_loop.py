"""The page of a closed loop."""

from pathlib import Path

from job import run_job
from wearscope.closed_loop.intake.dataset_fields import load_fields
from wearscope.reporting.closed_loop_page import write_closed_loop_page

with run_job(snakemake):
    dataset = Path(snakemake.input.dataset)
    urdf = dataset.parent / load_fields(dataset)["robot"]["urdf"]
    write_closed_loop_page(Path(snakemake.output[0]).parent, urdf)
