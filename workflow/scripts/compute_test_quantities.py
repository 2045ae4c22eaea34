"""Computes the test quantities of one robot and test-cycle, or joins those of chunks from other jobs."""

from pathlib import Path

from job import run_job
from quantities import quantify
from wearscope.designs.factors import Factor
from wearscope.detectors.run import join_test_quantities
from wearscope.robots.model import load_model
from wearscope.simulation.chunk import check_failures, failure_table, read_markers
from wearscope.simulation.recording import PackedRecordings
from wearscope.storage import tables

with run_job(snakemake) as say:
    given, params, w = snakemake.input, snakemake.params, snakemake.wildcards
    designs = {name: tables.read_table(given[name]) for name in params.sets}
    nominal = tables.read_table(given.nominal)
    if given.parts:
        points = {
            name: list(table["point"]) for name, table in [*designs.items(), (params.nominal_set, nominal)]
        }
        rows = [row for file in given.failed for row in tables.read_table(file).itertuples()]
        failures = {(row.set, row.point): row.reason for row in rows}
        check_failures(failures, points, f"robot {w.robot}, cycle {w.cycle}", params.max_failed_share)
        failed = failure_table(failures, points, w.robot, w.cycle)
        chunks = list(map(tables.read_arrow, given.parts))
        table = join_test_quantities(chunks, list(params.detectors), params.axes, params.max_failed_share)
    else:
        table, failed = quantify(
            say,
            Path(given.traces[0]).parents[1],
            load_model(params.reference, allow_code=params.allow_code),
            designs,
            nominal,
            read_markers(given.traces),
            params,
            [Factor(**one) for one in params.factors],
            w.robot,
            w.cycle,
            packed=PackedRecordings(given.recordings),
            nominal_set=params.nominal_set,
        )
        table = tables.to_arrow(table)
    tables.write_table(snakemake.output.failed, failed)
    tables.write_arrow(snakemake.output.table, table)
