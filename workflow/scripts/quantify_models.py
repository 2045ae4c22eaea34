"""Computes the test quantities of all models of one side (before, after, truth) of a reevaluation."""

import json
import shutil
from pathlib import Path

import pandas as pd

from job import run_job
from quantities import quantify
from wearscope.designs.factors import Factor
from wearscope.errors import InputError
from wearscope.robots.model import load_model
from wearscope.storage import tables

with run_job(snakemake) as say:
    params, given, side = snakemake.params, snakemake.input, snakemake.wildcards.side
    simulated = json.loads(Path(given.traces).read_text())
    factors = [Factor(**one) for one in params.factors]
    left_out = [{"model": name, "reason": why} for name, why in simulated["left_out"].items()]
    parts = {}
    for name, cycles in simulated["traces"].items():
        path = Path(given.models).parent / "models" / f"{name}.yaml"
        model = load_model(path, strict=False, allow_code=params.allow_code)
        try:
            made = []
            for label, sets in cycles.items():
                designs = {one: tables.read_table(given[one]) for one in sets if one != "nominal"}
                fingerprints, failed = (
                    {(one, int(point)): text for one in sets for point, text in sets[one][what].items()}
                    for what in ("fingerprints", "failed")
                )
                folder = Path(given.traces).parent / name / label
                table, _ = quantify(
                    say,
                    folder,
                    model,
                    designs,
                    tables.read_table(given.nominal),
                    (fingerprints, failed),
                    params,
                    factors,
                    name,
                    label,
                )
                made.append(table)
            parts[name] = pd.concat(made, ignore_index=True)
        except InputError as error:
            if name == side:
                raise
            left_out.append({"model": name, "reason": str(error)})
            say(f"{name} is left out: {error}")
    own = parts.pop(side)
    tables.write_table(snakemake.output.own, own)
    drawn = pd.concat(parts.values(), ignore_index=True) if parts else own.iloc[:0]
    tables.write_table(snakemake.output.drawn, drawn)
    tables.write_table(snakemake.output.left_out, pd.DataFrame(left_out, columns=["model", "reason"]))
    for name in simulated["traces"] if params.dropped else ():
        shutil.rmtree(Path(given.traces).parent / name)
