"""The loop closed on a measured data set."""

from pathlib import Path

from job import run_job
from wearscope.closed_loop.run import close_loop

with run_job(snakemake) as say:
    folder = Path(snakemake.output[0]).parent
    for old in folder.glob("*.parquet"):  # a table that this run does not write again would be the last one's
        old.unlink()
    close_loop(Path(snakemake.input.dataset), folder, progress=say)
