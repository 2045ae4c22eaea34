"""Concludes which detector to use, which wear it finds, which variation it tolerates, and its thresholds."""

import json
from functools import partial

from job import run_job
from wearscope.designs.factors import Factor, nominal_levels
from wearscope.detectors.base import list_bounds
from wearscope.evaluation.audit import resample_evidence, withheld_answers
from wearscope.evaluation.conclusion import conclude_study, threshold_tables
from wearscope.evaluation.snr import answer_rows
from wearscope.storage import tables
from wearscope.surrogates.chosen import read_cells

COLUMNS = [
    "robot", "cycle", "axis", "fda", "factor", "delta", "sigma", "passes", "method", "confidence",
]  # fmt: skip

with run_job(snakemake):
    given, out, params = snakemake.input, snakemake.output, snakemake.params
    factors = [Factor(**one) for one in params.factors]
    audited = [tables.read_table(file) for file in given.get("audit", [])]
    direct = tables.read_table(given.direct[0]) if len(given.get("direct", [])) else None
    conclusions, rankings = conclude_study(
        tables.Parts(given.scope, COLUMNS),
        answer_rows(tables.read_table(given.snr)),
        factors,
        params.scope["p_f"],
        params.scope["p_d"],
        withheld_answers(audited[2]) if audited else [],
        params.seed,
        list_bounds(params.detectors),
        partial(resample_evidence, *audited[:2], direct) if audited else None,
    )
    cells = (
        read_cells(params.scope["model"], *asked)
        for asked in zip(
            tables.Parts(given.test_quantities),
            tables.Parts(given.surrogates),
            tables.Parts(given.chosen) if given.get("chosen") else [None] * len(given.surrogates),
            strict=True,
        )
    )
    thresholds = threshold_tables(cells, conclusions, factors, nominal_levels(factors), params.scope["f0"])
    tables.write_table(out.thresholds, thresholds)
    tables.write_table(out.rankings, rankings)
    fields = [one.to_mapping() for one in conclusions]
    tables.write_text(out.conclusion, json.dumps(fields, indent=2, ensure_ascii=False) + "\n")
