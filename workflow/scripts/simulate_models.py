"""The design points of all models of one side of a reevaluation."""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

from job import count_progress, run_job
from wearscope import tables
from wearscope.cycles.base import load_cycle
from wearscope.errors import InputError
from wearscope.robots.model import load_model
from wearscope.simulation.chunk import Plan, simulate_chunk


def simulate(name, sets):
    """Simulate a model's points; return what became of them, by test-cycle and set."""
    path = Path(given.models).parent / "models" / f"{name}.yaml"
    common = hashlib.sha256(json.dumps(params.installed).encode())
    for file in [path, path.with_suffix(".urdf"), *given.code]:
        common.update(Path(file).read_bytes())
    model = load_model(path, strict=False, allow_code=params.allow_code).wearing(params.worn)
    outcomes = {}
    for label, reference in params.cycles.items():
        # One name for all: the sensors' noise is the same, so that models differ by themselves alone.
        plan = Plan("reevaluation", label, params.kinds, params.seed, params.step, params.sample_rate)
        for one in sets:
            rows = tables.read_arrow(given[one]).to_pylist()
            outcome = simulate_chunk(
                folder / name / label,
                one,
                rows,
                model,
                load_cycle(reference),
                plan,
                common.hexdigest(),
                count_progress(say, len(rows), f"{one} points of {name}, {label}"),
                params.time_limit,
            )
            for point, reason in outcome.failed.items():
                say(f"{name}, {one} point {point} failed: {reason}")
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
            traces[name] = simulate(name, params.sets if name == side else params.few_sets)
        except InputError as error:
            if name == side:
                raise
            left_out[name] = str(error)
            say(f"{name} is left out: {error}")
    text = json.dumps({"traces": traces, "left_out": left_out}, indent=1)
    tables.write_text(snakemake.output[0], text + "\n")
