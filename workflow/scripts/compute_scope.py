"""Computes at which wear and variation the detectors work (Q-3), for the cells of one robot."""

import numpy as np

from job import run_job
from wearscope.designs.factors import Factor, nominal_levels
from wearscope.evaluation.sampled_scope import scope_table
from wearscope.storage import tables
from wearscope.surrogates.chosen import read_chosen
from wearscope.surrogates.fitting import surrogates_of

with run_job(snakemake) as say:
    settings = snakemake.params.settings
    n_delta, n_sigma = settings["grid"]
    common = {
        "deltas": np.linspace(*settings["delta"], n_delta),
        "sigmas": np.linspace(*settings["sigma"], n_sigma),
        "f0": settings["f0"],
        "levels": nominal_levels([Factor(**one) for one in snakemake.params.factors]),
        "false_alarm": settings["p_f"],
        "detection": settings["p_d"],
        "runs": settings["runs"],
        "seed": snakemake.params.seed,
    }

    def read_cells(name):
        table = tables.read_table(snakemake.input[name])
        return table[table["robot"] == snakemake.wildcards.robot]

    if settings["model"] == "chosen":
        cells = read_chosen(read_cells("chosen"), read_cells("test_quantities"))
    else:
        cells = surrogates_of(read_cells("surrogates"), settings["model"])
    table = scope_table(cells, settings["factors"], **common)
    tables.write_table(snakemake.output[0], table)
