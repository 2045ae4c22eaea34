"""Compares the findings of the study with those of the paper."""

from job import run_job
from wearscope.designs.factors import Factor
from wearscope.evaluation.snr import answer_rows
from wearscope.reporting.findings import compare_with_paper, findings_table
from wearscope.reporting.study import Study
from wearscope.storage import tables

TABLES = (
    "surrogates", "validation", "sensitivity", "ranking", "scope", "failures", "checks",
)  # fmt: skip

with run_job(snakemake):
    given, params = snakemake.input, snakemake.params
    study = Study(
        config=params.config,
        factors=[Factor(**one) for one in params.factors],
        **{name: tables.read_table(given[name]) for name in TABLES},
        snr=answer_rows(tables.read_table(given.snr)),
        audit_answers=tables.read_table(given.answers) if given.get("answers") else None,
    )
    tables.write_table(snakemake.output[0], findings_table(compare_with_paper(study)))
