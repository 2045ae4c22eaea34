"""Figure of two recordings that differ in wear."""

from pathlib import Path

from job import run_job
from wearscope import tables
from wearscope.designs.factors import Factor
from wearscope.reporting.figures.recording import choose_pair, draw_recording
from wearscope.reporting.style import save_figure
from wearscope.robots.model import load_model
from wearscope.simulation.failures import read_markers
from wearscope.simulation.packed import PackedRecordings
from wearscope.simulation.traces import read_points

with run_job(snakemake):
    params, out = snakemake.params, snakemake.output
    factors = [Factor(**one) for one in params.factors]
    identification = tables.read_table(snakemake.input.design)
    robot, reference = next(iter(params.robots.items()))
    model = load_model(reference, allow_code=params.allow_code).wearing(params.worn)
    joint = model.joints.index(model.wear_joints[params.worn.index(params.axis)])
    packed = PackedRecordings(snakemake.input.recordings)
    traces = Path(snakemake.input.traces[0]).parents[1]
    fingerprints, failures = read_markers(snakemake.input.traces)
    failed = [point for _, point in failures]
    pair = choose_pair(identification[~identification["point"].isin(failed)], factors)
    recordings = read_points(traces, "identification", pair, model, fingerprints, packed)
    less, more = (one for _, one in recordings)
    coded = identification.set_index("point")["f_natural"]
    figure = draw_recording(
        less,
        more,
        joint,
        f"{robot}, {params.cycle}, axis {params.axis}",
        tuple(f"wear {coded[point]:g}" for point in pair),
        (model.position_units[joint], model.torque_units[joint]),
    )
    save_figure(figure, out.recording_svg, out.recording_png)
