"""Compares one session with the healthy machine."""

from job import run_job
from wearscope.tracking.run import tell_changes, write_session

with run_job(snakemake) as say:
    params = snakemake.params
    record = write_session(
        snakemake.input.dataset,
        params.session,
        snakemake.input.reference[0],
        snakemake.output[0],
        level=params.level,
        effects=params.effects,
        allow_code=params.allow_code,
    )
    say(tell_changes(record))
