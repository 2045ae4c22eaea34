"""Joins the audits of all partitions, and decides which detectors' answers are withheld."""

import pandas as pd

from job import run_job
from wearscope.evaluation.audit import audit_verdicts, weigh_evidence
from wearscope.storage import tables

with run_job(snakemake):
    out = snakemake.output
    table = pd.concat(list(tables.Parts(snakemake.input.parts)), ignore_index=True)
    tables.write_table(out.audit, table)
    verdicts = audit_verdicts(table)
    tables.write_table(out.verdicts, verdicts)
    tables.write_table(out.answers, weigh_evidence(table, verdicts))
