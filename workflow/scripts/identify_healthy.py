"""Identifies the healthy machine from the reference sessions of a data set."""

from job import run_job
from wearscope.closed_loop.inference.policy import Policy
from wearscope.tracking.run import write_reference

with run_job(snakemake) as say:
    params = snakemake.params
    write_reference(
        snakemake.input.dataset,
        snakemake.output[0],
        policy=Policy(**params.policy),
        progress=say,
        effects=params.effects,
        allow_code=params.allow_code,
    )
