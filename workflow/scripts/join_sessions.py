"""What changed in all sessions, and since when."""

from pathlib import Path

from job import run_job
from wearscope.tracking.run import join_sessions

with run_job(snakemake):
    params = snakemake.params
    join_sessions(
        snakemake.input.dataset,
        snakemake.input.reference[0],
        list(snakemake.input.sessions),
        Path(snakemake.output[0]).parent,
        level=params.level,
        effects=params.effects,
        allow_code=params.allow_code,
    )
