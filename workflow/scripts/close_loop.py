"""The loop closed on a measured data set."""

from pathlib import Path

from job import run_job
from wearscope.closed_loop.run import close_loop

with run_job(snakemake) as say:
    close_loop(Path(snakemake.input.dataset), Path(snakemake.output[0]).parent, progress=say)
