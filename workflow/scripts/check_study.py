"""Refuses a study that cannot be done, before anything is simulated."""

import json

from job import run_job
from wearscope import tables
from wearscope.cycles.base import load_cycle
from wearscope.detectors.base import load_detector
from wearscope.errors import InputError
from wearscope.robots.model import load_model
from wearscope.simulation.feasibility import check_cycle, check_robot

with run_job(snakemake) as say:
    params = snakemake.params
    for detector in params.detectors.values():
        load_detector(detector["use"], detector["options"])
    durations = {}
    cycles = {name: load_cycle(reference) for name, reference in params.cycles.items()}
    for robot, reference in params.robots.items():
        model = load_model(reference)
        check_robot(model, params.ranges, params.step, params.sample_rate)
        if max(params.axes) > model.n:
            raise InputError(
                f"axes: robot '{robot}' has {model.n} axes, not {max(params.axes)}; drop the axis."
            )
        durations[robot] = {}
        for name, cycle in cycles.items():
            seconds = check_cycle(model, cycle, name, params.ranges, params.step)
            say(f"{robot} can do {name}, {seconds:.1f} s")
            durations[robot][name] = round(seconds, 6)
    tables.write_text(snakemake.output[0], json.dumps({"duration_s": durations}, indent=1) + "\n")
