"""Figures of what is simulated: design, friction law, two recordings."""

from pathlib import Path

import pandas as pd

from job import run_job
from wearscope import tables
from wearscope.designs.factors import Factor
from wearscope.reporting.figures.design import draw_design
from wearscope.reporting.figures.friction import draw_friction
from wearscope.reporting.figures.recording import choose_pair, draw_recording
from wearscope.reporting.style import save_figure
from wearscope.robots.friction import friction_curves
from wearscope.robots.model import load_model
from wearscope.simulation.failures import read_markers
from wearscope.simulation.packed import PackedRecordings
from wearscope.simulation.traces import read_points

with run_job(snakemake):
    params, out = snakemake.params, snakemake.output
    factors = [Factor(**one) for one in params.factors]
    designs = {Path(file).stem: tables.read_table(file) for file in snakemake.input.designs}
    models = {
        robot: load_model(reference, allow_code=params.allow_code).wearing(params.worn)
        for robot, reference in params.robots.items()
    }

    save_figure(draw_design(designs, factors), out.design_svg, out.design_png)

    warmth = [(one.low, 0.5 * (one.low + one.high), one.high) for one in factors if one.kind == "temperature"]
    wear = [(one.low, one.high) for one in factors if one.kind == "wear"]
    curves = pd.concat(
        [
            friction_curves(model, *(warmth[:1] or [(50.0,)]), *(wear[:1] or [(0.0,)]))
            for model in models.values()
        ],
        ignore_index=True,
    )
    save_figure(draw_friction(curves), out.friction_svg, out.friction_png)

    robot, model = next(iter(models.items()))
    joint = model.joints.index(model.wear_joints[params.worn.index(params.axis)])
    packed = PackedRecordings(snakemake.input.recordings)
    traces = Path(snakemake.input.traces[0]).parents[1]
    fingerprints, failures = read_markers(snakemake.input.traces)
    failed = [point for _, point in failures]
    identification = designs["identification"]
    pair = choose_pair(identification[~identification["point"].isin(failed)], factors)
    recordings = read_points(traces, "identification", pair, model, fingerprints, packed)
    less, more = (one for _, one in recordings)
    coded = designs["identification"].set_index("point")["f_natural"]
    figure = draw_recording(
        less,
        more,
        joint,
        f"{robot}, {params.cycle}, axis {params.axis}",
        tuple(f"wear {coded[point]:g}" for point in pair),
        (model.position_units[joint], model.torque_units[joint]),
    )
    save_figure(figure, out.recording_svg, out.recording_png)
