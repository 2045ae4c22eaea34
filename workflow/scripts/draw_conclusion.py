"""Which detector to use, what it finds and bears, and its thresholds."""

import json

import pandas as pd

from job import run_job
from wearscope import tables
from wearscope.designs.factors import Factor, nominal_levels
from wearscope.evaluation.audit import withheld_answers
from wearscope.evaluation.conclusion import conclude_study, threshold_table
from wearscope.surrogates.chosen import read_cells

with run_job(snakemake):
    given, out, params = snakemake.input, snakemake.output, snakemake.params
    factors = [Factor(**one) for one in params.factors]
    withheld = withheld_answers(tables.read_table(given.answers)) if given.get("answers") else []
    conclusions, rankings = conclude_study(
        tables.read_table(given.scope),
        tables.read_table(given.snr),
        factors,
        params.scope["p_f"],
        params.scope["p_d"],
        withheld,
        params.seed,
    )
    cells = read_cells(
        params.scope["model"],
        tables.read_table(given.test_quantities),
        tables.read_table(given.surrogates),
        tables.read_table(given.chosen) if given.get("chosen") else None,
    )
    levels, f0 = nominal_levels(factors), params.scope["f0"]
    thresholds = [
        threshold_table(cells, one, factors, levels, f0).assign(asked=one.robot) for one in conclusions
    ]
    tables.write_table(out.thresholds, pd.concat(thresholds, ignore_index=True))
    tables.write_table(out.rankings, rankings)
    fields = [one.to_mapping() for one in conclusions]
    tables.write_text(out.conclusion, json.dumps(fields, indent=2, ensure_ascii=False) + "\n")
