"""Computes the robots' friction over speed, at several temperatures and wear levels."""

import pandas as pd

from job import run_job
from wearscope.designs.factors import Factor
from wearscope.robots.friction import friction_curves
from wearscope.robots.model import load_model
from wearscope.storage import tables

with run_job(snakemake):
    params = snakemake.params
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
    tables.write_table(snakemake.output[0], pd.concat(curves, ignore_index=True), units)
