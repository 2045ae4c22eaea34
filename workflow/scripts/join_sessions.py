"""Joins the results of all sessions, and finds since when there are changes."""

from pathlib import Path

from job import clear_answer, run_job
from wearscope.tracking.run import join_sessions

with run_job(snakemake):
    params, folder = snakemake.params, Path(snakemake.output[0]).parent
    clear_answer(folder)
    join_sessions(
        snakemake.input.dataset,
        snakemake.input.reference[0],
        list(snakemake.input.sessions),
        folder,
        level=params.level,
        limit=params.limit,
        effects=params.effects,
        allow_code=params.allow_code,
    )
