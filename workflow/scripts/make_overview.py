"""Makes the overview of a divided study: a row for each robot and test-cycle, the worst first."""

import json
from pathlib import Path

from job import run_job
from wearscope.designs.factors import Factor
from wearscope.evaluation.conclusion import overview_table, read_conclusion
from wearscope.evaluation.snr import answer_rows
from wearscope.storage import tables

with run_job(snakemake):
    given, params = snakemake.input, snakemake.params
    fits = tables.read_table(given.fits)
    table = overview_table(
        tables.read_table(given.scope),
        answer_rows(tables.read_table(given.snr)),
        fits[fits["model"] == params.model] if "model" in fits else fits,
        tables.read_table(given.failed_simulations),
        [read_conclusion(one) for one in json.loads(Path(given.conclusion).read_text(encoding="utf-8"))],
        [Factor(**one) for one in params.factors],
    )
    tables.write_table(snakemake.output[0], table, {"wear": params.unit, "fit": "%"})
