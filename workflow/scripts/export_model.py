"""Writes a model as URDF, MJCF and a table of parameters."""

from pathlib import Path

from job import run_job
from wearscope.export.run import export_model, read_verdict_of
from wearscope.robots.model import load_model

with run_job(snakemake) as say:
    params, path = snakemake.params, Path(snakemake.input.model[0])
    model = load_model(path, strict=False, allow_code=params.allow_code)
    folder = Path(snakemake.output[0]).parent
    summary = export_model(model, folder, read_verdict_of(path), params.temperature)
    for one in summary["left"]:
        say(f"not in {one['format']}: {one['effect']} at {one['joint']}: {one['reason']}")
