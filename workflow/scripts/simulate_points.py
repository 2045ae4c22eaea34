"""A chunk of the design points of one robot, test-cycle and set."""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

from job import count_progress, run_job
from wearscope import tables
from wearscope.cycles.base import load_cycle
from wearscope.robots.model import load_model
from wearscope.simulation.carried import pack_recordings
from wearscope.simulation.chunk import Plan, simulate_chunk

with run_job(snakemake) as say:
    params, w = snakemake.params, snakemake.wildcards
    plan = Plan(w.robot, w.cycle, params.kinds, params.seed, params.step, params.sample_rate)
    design = tables.read_arrow(snakemake.input.design).to_pylist()
    first = int(w.chunk) * params.size
    rows = design[first : first + params.size]
    common = hashlib.sha256()
    for file in [*snakemake.input.robot, *snakemake.input.code]:
        common.update(Path(file).read_bytes())
    outcome = simulate_chunk(
        Path(snakemake.output.marker).parents[1],
        w.set,
        rows,
        load_model(params.robot, allow_code=params.allow_code).wearing(params.worn),
        load_cycle(params.cycle),
        plan,
        common.hexdigest(),
        count_progress(say, len(rows), "points"),
        params.time_limit,
    )
    for point, reason in outcome.failed.items():
        say(f"point {point} failed: {reason}")
    if snakemake.output.recordings:
        pack_recordings(snakemake.output.recordings, outcome.fingerprints.keys() - outcome.failed.keys())
    tables.write_text(snakemake.output.marker, json.dumps(asdict(outcome), indent=1) + "\n")
