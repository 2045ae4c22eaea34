"""Writes the page of a closed loop; also shows it with its tables, if the job has that output."""

from pathlib import Path

from job import run_job
from wearscope.closed_loop.intake.dataset_fields import load_fields
from wearscope.reporting.closed_loop_page import write_closed_loop_page
from wearscope.storage.files import show_answer

with run_job(snakemake):
    dataset = Path(snakemake.input.dataset)
    urdf = dataset.parent / load_fields(dataset)["robot"]["urdf"]
    made, shown = Path(snakemake.input.tables[0]).parent, Path(snakemake.output[0]).parent
    write_closed_loop_page(made, urdf)
    if shown != made:
        show_answer(made, shown)
