"""How the detectors compare (Q-2)."""

from job import run_job
from wearscope import tables
from wearscope.evaluation.snr import rank_by_median, snr_table

with run_job(snakemake):
    settings = dict(snakemake.params.settings)
    group_by = settings.pop("group_by")
    snr = snr_table(tables.read_table(snakemake.input.surrogates), **settings, seed=snakemake.params.seed)
    tables.write_table(snakemake.output.snr, snr)
    ranking = rank_by_median(snr, by=group_by, seed=snakemake.params.seed)
    tables.write_table(snakemake.output.ranking, ranking)
