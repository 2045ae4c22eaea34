"""Simulates the design points of all models of one side (before, after, truth) of a reevaluation."""

import json
from dataclasses import asdict
from pathlib import Path

from job import run_job
from simulating import digest_inputs, simulate
from wearscope.cycles.base import load_cycle
from wearscope.errors import InputError
from wearscope.robots.model import load_model
from wearscope.simulation.chunk import Plan
from wearscope.storage import tables


def simulate_model(name, sets):
    """Simulate a model's points; return what became of them, by test-cycle and set."""
    path = Path(given.models).parent / "models" / f"{name}.yaml"
    common = digest_inputs(params.installed, [path, path.with_suffix(".urdf"), *given.code])
    model = load_model(path, strict=False, allow_code=params.allow_code).wearing(params.worn)
    outcomes = {}
    for label, reference in params.cycles.items():
        # The noise of the sensors depends on the name. With one name for all, only the models differ.
        plan = Plan("reevaluation", label, params.kinds, params.seed, params.step, params.sample_rate)
        cycle, traces, where = load_cycle(reference), folder / name / label, f", {name}, {label}"
        for one in sets:
            rows = tables.read_arrow(given[one]).to_pylist()
            outcome = simulate(say, traces, one, rows, model, cycle, plan, common, params.time_limit, where)
            outcomes.setdefault(label, {})[one] = asdict(outcome)
    return outcomes


with run_job(snakemake) as say:
    params, given, side = snakemake.params, snakemake.input, snakemake.wildcards.side
    folder = Path(snakemake.output[0]).parent
    traces, left_out = {}, {}
    for name, reason in json.loads(Path(given.models).read_text()).items():
        if reason or name.partition("-")[0] != side:
            continue
        try:
            traces[name] = simulate_model(name, params.sets if name == side else params.few_sets)
        except InputError as error:
            if name == side:
                raise
            left_out[name] = str(error)
            say(f"{name} is left out: {error}")
    text = json.dumps({"traces": traces, "left_out": left_out}, indent=1)
    tables.write_text(snakemake.output[0], text + "\n")
