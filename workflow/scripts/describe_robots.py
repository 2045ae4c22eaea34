"""The robots' friction over speed, and their postures along the test-cycles."""

import pandas as pd

from job import run_job
from wearscope import tables
from wearscope.cycles.base import load_cycle
from wearscope.cycles.poses import posture_table
from wearscope.designs.factors import Factor
from wearscope.robots.friction import friction_curves
from wearscope.robots.model import load_model

with run_job(snakemake):
    params, out = snakemake.params, snakemake.output
    factors = [Factor(**one) for one in params.factors]
    models = {
        robot: load_model(reference, allow_code=params.allow_code).wearing(params.worn)
        for robot, reference in params.robots.items()
    }
    warmth = [(one.low, 0.5 * (one.low + one.high), one.high) for one in factors if one.kind == "temperature"]
    wear = [(one.low, 0.5 * (one.low + one.high), one.high) for one in factors if one.kind == "wear"]
    curves = [
        friction_curves(model, *(warmth[:1] or [(50.0,)]), *(wear[:1] or [(0.0,)]), points=60).assign(
            robot=robot
        )
        for robot, model in models.items()
    ]
    units = {"temperature": "degC", "wear": "1"}
    tables.write_table(out.friction, pd.concat(curves, ignore_index=True), units)
    dwell = [0.0005 * (one.low + one.high) for one in factors if one.kind == "dwell"]
    postures = [
        posture_table(model, load_cycle(reference), *(dwell[:1] or [0.05])).assign(robot=robot, cycle=cycle)
        for robot, model in models.items()
        for cycle, reference in params.cycles.items()
    ]
    units = {"t": "s", "x": "m", "y": "m", "z": "m"}
    tables.write_table(out.postures, pd.concat(postures, ignore_index=True), units)
