"""Computes the surrogates along each factor, with the simulated runs, and the ROC of every cell."""

import numpy as np

from job import run_job
from wearscope.designs.factors import Factor, nominal_levels
from wearscope.evaluation.sampled_scope import (
    FALSE_ALARMS,
    detection_table,
    pick_levels,
    response_table,
    simulated_table,
)
from wearscope.storage import tables
from wearscope.surrogates.chosen import read_cells

with run_job(snakemake) as say:
    given, out, scope = snakemake.input, snakemake.output, snakemake.params.scope
    factors = [Factor(**one) for one in snakemake.params.factors]
    levels = nominal_levels(factors)
    runs = tables.read_table(given.test_quantities)
    cells = read_cells(
        scope["model"],
        runs,
        tables.read_table(given.surrogates),
        tables.read_table(given.chosen) if given.get("chosen") else None,
    )
    tables.write_table(out.responses, response_table(cells, factors, levels))
    say("responses are computed")
    tables.write_table(out.simulated, simulated_table(cells, runs, factors, levels))
    deltas, sigmas = (
        pick_levels(np.linspace(*scope[name], count), most)
        for name, count, most in zip(("delta", "sigma"), scope["grid"], (8, 5), strict=True)
    )
    alarms = sorted({*FALSE_ALARMS, scope["p_f"]})
    detection = detection_table(cells, levels, scope["factors"], deltas, sigmas, scope["f0"], alarms)
    tables.write_table(out.detection, detection)
