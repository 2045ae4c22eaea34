"""Computes the test quantities of a chunk of design points, for one robot and test-cycle."""

from pathlib import Path

from job import run_job
from quantities import quantify
from wearscope.designs.factors import Factor
from wearscope.robots.model import load_model
from wearscope.simulation.chunk import read_markers
from wearscope.simulation.recording import PackedRecordings
from wearscope.storage import tables

with run_job(snakemake) as say:
    given, params, w = snakemake.input, snakemake.params, snakemake.wildcards
    design, first = tables.read_table(given.design), int(w.chunk) * params.size
    table, failed = quantify(
        say,
        Path(given.traces[0]).parents[1],
        load_model(params.reference, allow_code=params.allow_code),
        {w.set: design[first : first + params.size]},
        tables.read_table(given.nominal),
        read_markers(given.traces),
        params,
        [Factor(**one) for one in params.factors],
        w.robot,
        w.cycle,
        {w.set: len(design)},
        PackedRecordings(given.recordings),
        params.nominal_set,
    )
    tables.write_table(snakemake.output.failed, failed)
    tables.write_table(snakemake.output.table, table)
