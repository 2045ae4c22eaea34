"""Writes the report of a divided study: an overview with links to the partitions' reports."""

import json
from pathlib import Path

import pandas as pd

from job import run_job
from made import tell_provenance
from wearscope.designs.factors import Factor
from wearscope.detectors.base import name_unit
from wearscope.evaluation.conclusion import read_conclusion, sort_worst_first
from wearscope.plugins import load
from wearscope.reporting.overview_page import render_overview
from wearscope.reporting.study import Study
from wearscope.robots.model import load_model
from wearscope.storage import tables
from wearscope.storage.files import show_answer

TABLES = ("sensitivity", "ranking", "failures", "failed_simulations", "thresholds")
#: Tables with a row for each cell; the partitions' reports show them.
LEFT_OUT = ("surrogates", "validation", "snr", "scope", "checks")

with run_job(snakemake) as say:
    given, params, out = snakemake.input, snakemake.params, snakemake.output
    overview = sort_worst_first(pd.concat(list(tables.Parts(given.overviews)), ignore_index=True))
    tables.write_table(out.overview, overview, tables.read_units(given.overviews[0]))
    answers = tables.read_table(given.answers) if given.get("answers") else None
    detectors = {
        name: load(one["use"], "detectors", "DETECTOR") for name, one in params.config["detectors"].items()
    }

    def models():
        """The robots' models, one at a time."""
        return (load_model(file, allow_code=params.allow_code) for file in params.robots.values())

    study = Study(
        config=params.config,
        factors=[Factor(**one) for one in params.factors],
        **{name: tables.read_table(given[name]) for name in TABLES},
        **dict.fromkeys(LEFT_OUT, pd.DataFrame()),
        audit=answers,
        audit_answers=answers,
        figures={Path(file).stem: Path(file) for file in given.figures if file.endswith(".svg")},
        conclusions=[
            read_conclusion(one) for one in json.loads(Path(given.conclusion).read_text(encoding="utf-8"))
        ],
        units={name: name_unit(detector, models()) for name, detector in detectors.items()},
        provenance=tell_provenance(),
    )
    made = Path(given.conclusion).parent
    tables.write_text(made / "report.html", render_overview(study, overview, params.pages))
    show_answer(made, Path(out.report).parent)
    say(f"{len(overview)} robots and test-cycles, the worst first")
