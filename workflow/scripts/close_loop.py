"""Closes the loop on a measured data set: finds effects that the model lacks, and corrects it."""

from pathlib import Path

from job import clear_answer, run_job
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.run import close_loop

with run_job(snakemake) as say:
    folder, params = Path(snakemake.output[0]).parent, snakemake.params
    clear_answer(folder)
    close_loop(
        Path(snakemake.input.dataset),
        folder,
        policy=Policy(**params.policy),
        progress=say,
        effects=params.effects,
        allow_code=params.allow_code,
        draws=params.draws,
    )
