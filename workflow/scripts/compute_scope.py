"""Where the detectors work (Q-3), for the cells of one robot."""

import numpy as np

from job import run_job
from wearscope import tables
from wearscope.designs.factors import Factor, nominal_levels
from wearscope.evaluation.scope import scope_table

with run_job(snakemake) as say:
    surrogates = tables.read_table(snakemake.input.surrogates)
    settings = snakemake.params.settings
    n_delta, n_sigma = settings["grid"]
    table = scope_table(
        surrogates[surrogates["robot"] == snakemake.wildcards.robot],
        settings["factors"],
        settings["model"],
        deltas=np.linspace(*settings["delta"], n_delta),
        sigmas=np.linspace(*settings["sigma"], n_sigma),
        f0=settings["f0"],
        levels=nominal_levels([Factor(**one) for one in snakemake.params.factors]),
        false_alarm=settings["p_f"],
        detection=settings["p_d"],
        runs=settings["runs"],
        seed=snakemake.params.seed,
    )
    tables.write_table(snakemake.output[0], table)
