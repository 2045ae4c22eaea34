"""The design points of all models of one side of a reevaluation."""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

from job import count_progress, run_job
from wearscope import tables
from wearscope.cycles.base import load_cycle
from wearscope.robots.model import load_model
from wearscope.simulation.chunk import Plan, simulate_chunk

with run_job(snakemake) as say:
    params, given = snakemake.params, snakemake.input
    names = [
        name
        for name, reason in json.loads(Path(given.models).read_text()).items()
        if not reason and name.partition("-")[0] == snakemake.wildcards.side
    ]
    folder = Path(snakemake.output[0]).parent
    outcomes = {}
    for name in names:
        path = Path(given.models).parent / "models" / f"{name}.yaml"
        common = hashlib.sha256()
        for file in [path, path.with_suffix(".urdf"), *given.code]:
            common.update(Path(file).read_bytes())
        model = load_model(path, strict=False, allow_code=params.allow_code)
        for label, reference in params.cycles.items():
            # One name for all: the sensors' noise is the same, so that models differ by themselves alone.
            plan = Plan("reevaluation", label, params.kinds, params.seed, params.step, params.sample_rate)
            sets = params.sets if name == snakemake.wildcards.side else params.few_sets
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
                outcomes.setdefault(name, {}).setdefault(label, {})[one] = asdict(outcome)
    tables.write_text(snakemake.output[0], json.dumps(outcomes, indent=1) + "\n")
