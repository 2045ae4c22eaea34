"""Joins the scope tables into one and computes the group scope matrices."""

from job import run_job
from screening import read_screening
from wearscope.evaluation.scope import add_counts, group_scope
from wearscope.evaluation.sensitivity import drop_idle
from wearscope.storage import tables

with run_job(snakemake):
    screening = read_screening(snakemake.input.screening)
    groups = []

    def keep(part):
        part = drop_idle(part, screening, "factor")
        groups[:] = [add_counts([*groups, group_scope(part, snakemake.params.group_by)])]
        return part

    parts = tables.Parts(snakemake.input.parts)
    tables.join_tables(snakemake.output.scope, parts.by("robot", keep))
    tables.write_table(snakemake.output.groups, groups[0])
