"""Computes the SNR of every cell and ranks the detectors (Q-2)."""

from itertools import chain

from job import run_job
from wearscope.detectors.base import list_bounds
from wearscope.evaluation.ranking import rank_deployable
from wearscope.evaluation.snr import answer_rows, snr_table
from wearscope.storage import tables
from wearscope.surrogates.chosen import read_chosen, read_noise
from wearscope.surrogates.fitting import surrogates_of

with run_job(snakemake):
    given, seed = snakemake.input, snakemake.params.seed
    settings = dict(snakemake.params.settings)
    group_by = settings.pop("group_by")
    model = settings.pop("model")
    if model == "chosen":
        table = tables.read_table(given.chosen)
        noise = read_noise(table)
        cells = read_chosen(table, tables.read_table(given.test_quantities))
        if given.get("paper"):
            cells = chain(cells, surrogates_of(tables.read_table(given.paper), "full"))
    else:
        noise = read_noise(tables.read_table(given.noise)) if given.get("noise") else None
        cells = surrogates_of(tables.read_table(given.surrogates), model)
    snr = snr_table(cells, **settings, seed=seed, noise=noise)
    tables.join_tables(snakemake.output.snr, (rows for _, rows in snr.groupby("robot", sort=False)))
    upper = list_bounds(snakemake.params.detectors)
    ranking = rank_deployable(answer_rows(snr), upper, by=group_by, seed=seed)
    tables.write_table(snakemake.output.ranking, ranking)
