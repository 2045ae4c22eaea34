"""One scope table, its group scope matrices, and where the two methods disagree."""

import pandas as pd

from job import run_job
from screening import read_screening
from wearscope import tables
from wearscope.evaluation.scope import group_scope, scope_disagreement
from wearscope.simulation.screening import drop_idle

with run_job(snakemake) as say:
    scope = pd.concat([tables.read_table(part) for part in snakemake.input.parts], ignore_index=True)
    scope = drop_idle(scope, read_screening(snakemake.input.screening), "factor")
    tables.write_table(snakemake.output.scope, scope)
    tables.write_table(snakemake.output.groups, group_scope(scope, snakemake.params.group_by))
    disagreement = scope_disagreement(scope)
    say(f"the two methods disagree in {len(disagreement)} of {len(scope) // 2} grid cells")
    tables.write_table(snakemake.output.disagreement, disagreement)
