"""Computes the SNR of every cell and ranks the detectors (Q-2)."""

import pandas as pd

from job import run_job
from wearscope.detectors.base import list_bounds
from wearscope.evaluation.ranking import rank_deployable
from wearscope.evaluation.snr import answer_rows, sampled_snr_table, snr_table
from wearscope.storage import tables
from wearscope.surrogates.chosen import read_chosen, read_noise

with run_job(snakemake):
    given, seed = snakemake.input, snakemake.params.seed
    settings = dict(snakemake.params.settings)
    group_by = settings.pop("group_by")
    if settings["model"] == "chosen":
        del settings["model"]
        table = tables.read_table(given.chosen)
        chosen = read_chosen(table, tables.read_table(given.test_quantities))
        snr = sampled_snr_table(chosen, read_noise(table), **settings, seed=seed)
        if given.get("paper"):
            quadratic = tables.read_table(given.paper)
            paper = snr_table(quadratic, "full", **settings, seed=seed, noise=read_noise(table))
            snr = pd.concat([snr, paper], ignore_index=True)
    else:
        noise = read_noise(tables.read_table(given.noise)) if given.get("noise") else None
        snr = snr_table(tables.read_table(given.surrogates), **settings, seed=seed, noise=noise)
    tables.join_tables(snakemake.output.snr, (rows for _, rows in snr.groupby("robot", sort=False)))
    upper = list_bounds(snakemake.params.detectors)
    ranking = rank_deployable(answer_rows(snr), upper, by=group_by, seed=seed)
    tables.write_table(snakemake.output.ranking, ranking)
