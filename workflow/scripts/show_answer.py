"""Replaces an earlier answer by the new one, all files together."""

from pathlib import Path

from job import run_job
from wearscope.storage.files import show_answer

with run_job(snakemake):
    show_answer(Path(snakemake.output[0]).parent, Path(snakemake.params.folder))
