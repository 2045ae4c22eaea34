"""Simulates chunks of the design points of one robot and test-cycle."""

import json
from dataclasses import asdict
from pathlib import Path

from job import run_job
from simulating import digest_inputs, simulate
from wearscope.cycles.base import load_cycle
from wearscope.robots.model import load_model
from wearscope.simulation.chunk import Plan
from wearscope.simulation.recording import pack_recordings, remove_recordings
from wearscope.storage import tables

with run_job(snakemake) as say:
    params, w = snakemake.params, snakemake.wildcards
    plan = Plan(w.robot, w.cycle, params.kinds, params.seed, params.step, params.sample_rate)
    model = load_model(params.robot, allow_code=params.allow_code).wearing(params.worn)
    cycle = load_cycle(params.cycle)
    common = digest_inputs(params.installed, [*snakemake.input.robot, *snakemake.input.code])
    listed = snakemake.input.design
    designs = {Path(file).stem: file for file in ([listed] if isinstance(listed, str) else listed)}
    outputs = list(map(Path, snakemake.output))
    for marker in (file for file in outputs if file.suffix == ".json"):
        name, traces = marker.parent.name, marker.parents[1]
        first = int(marker.stem.rpartition("-")[2]) * params.size
        rows = tables.read_arrow(designs[name]).to_pylist()[first : first + params.size]
        outcome = simulate(say, traces, name, rows, model, cycle, plan, common, params.time_limit)
        packed = marker.with_suffix(".tar")
        if packed in outputs:
            recorded = outcome.fingerprints.keys() - outcome.failed.keys()
            pack_recordings(packed, recorded)
            if params.packed:
                remove_recordings(packed.parent, recorded)
        tables.write_text(marker, json.dumps(asdict(outcome), indent=1) + "\n")
