"""How the detectors compare (Q-2), from the SNR of every cell."""

from job import run_job
from wearscope import tables
from wearscope.evaluation.snr import rank_by_median

with run_job(snakemake):
    params = snakemake.params
    ranking = rank_by_median(tables.read_table(snakemake.input.snr), by=params.group_by, seed=params.seed)
    tables.write_table(snakemake.output[0], ranking)
