"""Test quantities of one robot and test-cycle."""

from pathlib import Path

from job import count_progress, run_job
from wearscope import tables
from wearscope.designs.factors import Factor
from wearscope.detectors.base import Batch
from wearscope.detectors.run import DetectorSpec, compute_test_quantities
from wearscope.robots.model import load_model
from wearscope.simulation.traces import read_points

with run_job(snakemake) as say:
    params, w = snakemake.params, snakemake.wildcards
    traces = Path(snakemake.input.traces[0]).parents[1]
    model = load_model(params.reference)
    designs = {name: tables.read_table(snakemake.input[name]) for name in params.sets}
    nominal = tables.read_table(snakemake.input.nominal)

    def read_batches(name, table):
        for point, one in read_points(traces, name, table["point"], model):
            yield name, point, Batch(one.t, one.q, one.qd, one.tau)

    table = compute_test_quantities(
        (batch for name, design in designs.items() for batch in read_batches(name, design)),
        [DetectorSpec(name, one["use"], one["options"]) for name, one in params.detectors.items()],
        params.axes,
        model,
        [batch for _, _, batch in read_batches("nominal", nominal)],
        robot=w.robot,
        cycle=w.cycle,
        designs=designs,
        factors=[Factor(**one) for one in params.factors],
        max_failed_share=params.max_failed_share,
        report=count_progress(say, sum(map(len, designs.values())), "batches"),
    )
    tables.write_table(snakemake.output[0], table)
