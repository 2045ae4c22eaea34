"""One scope table, its group scope matrices, and where the two methods disagree."""

import pandas as pd

from job import run_job
from screening import read_screening
from wearscope import tables
from wearscope.evaluation.scope import add_group_scopes, group_scope, scope_disagreement
from wearscope.simulation.idle import drop_idle

with run_job(snakemake) as say:
    screening = read_screening(snakemake.input.screening)
    groups, disagreement = [], []

    def keep(part):
        part = drop_idle(part, screening, "factor")
        groups[:] = [add_group_scopes([*groups, group_scope(part, snakemake.params.group_by)])]
        disagreement.append(scope_disagreement(part))
        return part

    parts = tables.Parts(snakemake.input.parts)
    rows = tables.join_tables(snakemake.output.scope, parts.by("robot", keep))
    tables.write_table(snakemake.output.groups, groups[0])
    disagreement = pd.concat(disagreement, ignore_index=True)
    say(f"the two methods disagree in {len(disagreement)} of {rows // 2} grid cells")
    tables.write_table(snakemake.output.disagreement, disagreement)
