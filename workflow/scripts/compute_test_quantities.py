"""Test quantities of one robot and test-cycle."""

from pathlib import Path

from job import count_progress, run_job
from wearscope import tables
from wearscope.designs.factors import Factor
from wearscope.detectors.base import Batch
from wearscope.detectors.run import DetectorSpec, compute_test_quantities
from wearscope.robots.model import load_model
from wearscope.simulation.failures import check_failures, failure_table, read_markers
from wearscope.simulation.traces import read_points

with run_job(snakemake) as say:
    params, w = snakemake.params, snakemake.wildcards
    traces = Path(snakemake.input.traces[0]).parents[1]
    model = load_model(params.reference, allow_code=params.allow_code)
    designs = {name: tables.read_table(snakemake.input[name]) for name in params.sets}
    nominal = tables.read_table(snakemake.input.nominal)

    fingerprints, failed = read_markers(snakemake.input.traces)
    points = {name: list(table["point"]) for name, table in [*designs.items(), ("nominal", nominal)]}
    check_failures(failed, points, f"robot {w.robot}, cycle {w.cycle}", params.max_failed_share)

    def read_batches(name):
        there = [point for point in points[name] if (name, point) not in failed]
        for point, one in read_points(traces, name, there, model, fingerprints):
            yield name, point, Batch(one.t, one.q, one.qd, one.tau)

    batches = sum((name, point) not in failed for name in designs for point in points[name])
    table = compute_test_quantities(
        (batch for name in designs for batch in read_batches(name)),
        [DetectorSpec(name, one["use"], one["options"]) for name, one in params.detectors.items()],
        params.axes,
        model,
        [batch for _, _, batch in read_batches("nominal")],
        robot=w.robot,
        cycle=w.cycle,
        designs=designs,
        factors=[Factor(**one) for one in params.factors],
        max_failed_share=params.max_failed_share,
        failed_simulations=failed,
        report=count_progress(say, batches, "batches"),
        time_limit=params.time_limit,
    )
    tables.write_table(snakemake.output.failed, failure_table(failed, points, w.robot, w.cycle))
    tables.write_table(snakemake.output.table, table)
