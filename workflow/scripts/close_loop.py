"""The loop closed on a measured data set."""

from pathlib import Path

from job import run_job
from wearscope.closed_loop.run import close_loop
from wearscope.closed_loop.selection.policy import Policy

with run_job(snakemake) as say:
    folder, params = Path(snakemake.output[0]).parent, snakemake.params
    for old in folder.glob("*.parquet"):  # a table that this run does not write again would be the last one's
        old.unlink()
    close_loop(
        Path(snakemake.input.dataset),
        folder,
        policy=Policy(**params.policy),
        progress=say,
        effects=params.effects,
        allow_code=params.allow_code,
        draws=params.draws,
    )
