"""Refuses a robot that cannot perform a test-cycle within its factor ranges, before the simulation."""

import json
from functools import partial
from pathlib import Path

from job import run_job
from wearscope.cycles.base import load_cycle
from wearscope.robots.model import load_model
from wearscope.simulation.feasibility import check_cycle, check_robot, check_start
from wearscope.storage import tables
from wearscope.supervision import call_supervised


def check(label, reference):
    """Return the longest duration of a test-cycle [s]."""
    model = load_model(params.robot, allow_code=params.allow_code).wearing(params.worn)
    check_robot(model, params.ranges, params.step, params.sample_rate)
    cycle = load_cycle(reference)
    seconds = check_cycle(model, cycle, label, params.ranges, params.step)
    check_start(model, cycle, label, params.step, params.sample_rate)
    return seconds


with run_job(snakemake) as say:
    params, w = snakemake.params, snakemake.wildcards
    for file in map(Path, snakemake.output):
        label = file.stem
        what = f"robot {w.robot}, cycle {label}: checking it"
        seconds = call_supervised(partial(check, label, params.cycles[label]), params.time_limit, what)
        say(f"{label} is feasible, {seconds:.1f} s")
        tables.write_text(file, json.dumps({"duration_s": round(seconds, 6)}) + "\n")
