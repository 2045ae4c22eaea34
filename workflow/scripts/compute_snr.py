"""How the detectors compare (Q-2)."""

from job import run_job
from wearscope import tables
from wearscope.detectors.base import list_bounds
from wearscope.evaluation.ranking import rank_deployable
from wearscope.evaluation.sampled_snr import sampled_snr_table
from wearscope.evaluation.snr import snr_table
from wearscope.surrogates.chosen import read_chosen, read_noise

with run_job(snakemake):
    settings = dict(snakemake.params.settings)
    group_by = settings.pop("group_by")
    if settings["model"] == "chosen":
        del settings["model"]
        table = tables.read_table(snakemake.input.chosen)
        chosen = read_chosen(table, tables.read_table(snakemake.input.test_quantities))
        snr = sampled_snr_table(chosen, read_noise(table), **settings, seed=snakemake.params.seed)
    else:
        replicates = snakemake.input.get("noise")
        noise = read_noise(tables.read_table(replicates)) if replicates else None
        quadratic = tables.read_table(snakemake.input.surrogates)
        snr = snr_table(quadratic, **settings, seed=snakemake.params.seed, noise=noise)
    tables.join_tables(snakemake.output.snr, (rows for _, rows in snr.groupby("robot", sort=False)))
    upper = list_bounds(snakemake.params.detectors)
    ranking = rank_deployable(snr, upper, by=group_by, seed=snakemake.params.seed)
    tables.write_table(snakemake.output.ranking, ranking)
