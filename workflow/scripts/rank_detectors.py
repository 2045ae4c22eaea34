"""Ranks the detectors (Q-2) by the SNR of every cell."""

from job import run_job
from wearscope.detectors.base import list_bounds
from wearscope.evaluation.ranking import rank_deployable
from wearscope.evaluation.snr import answer_rows
from wearscope.storage import tables

with run_job(snakemake):
    params = snakemake.params
    snr, upper = answer_rows(tables.read_table(snakemake.input.snr)), list_bounds(params.detectors)
    ranking = rank_deployable(snr, upper, by=params.group_by, seed=params.seed)
    tables.write_table(snakemake.output[0], ranking)
