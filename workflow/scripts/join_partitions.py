"""Joins a table of the partitions of a divided study; robots are sorted by name."""

from job import run_job
from wearscope.storage import tables

with run_job(snakemake) as say:
    names = sorted(snakemake.params.robots)
    parts = dict(zip(snakemake.params.robots, snakemake.input.parts, strict=True))

    def rows_of(robot):
        table = tables.read_table(parts[robot])
        return table[table["robot"] == robot]

    units = tables.read_units(parts[names[0]])
    rows = tables.join_tables(snakemake.output[0], map(rows_of, names), units)
    say(f"{rows:,} rows of {len(names)} robots")
