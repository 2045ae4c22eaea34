"""The report: one self-contained page."""

import json
from pathlib import Path

from job import run_job
from made import tell_provenance
from reevaluated import read_reevaluation
from screening import read_screening
from wearscope.designs.factors import Factor
from wearscope.detectors.base import name_unit
from wearscope.evaluation.conclusion import read_conclusion
from wearscope.evaluation.snr import answer_rows
from wearscope.plugins import load
from wearscope.reporting.findings import read_findings
from wearscope.reporting.study import Study
from wearscope.reporting.study_page import render_study
from wearscope.robots.model import load_model
from wearscope.storage import tables
from wearscope.storage.files import show_answer

TABLES = (
    "surrogates", "validation", "sensitivity", "ranking", "scope", "failures",
    "failed_simulations", "checks", "thresholds", "rankings", "responses", "simulated", "detection",
    "friction",
)  # fmt: skip

with run_job(snakemake):
    given, params = snakemake.input, snakemake.params
    audit = {Path(file).stem: tables.read_table(file) for file in given.get("audit", [])}
    models = {
        robot: load_model(reference, allow_code=params.allow_code)
        for robot, reference in params.robots.items()
    }
    detectors = {
        name: load(one["use"], "detectors", "DETECTOR") for name, one in params.config["detectors"].items()
    }
    snr = tables.read_table(given.snr)
    paper = snr[snr["model"] == "full"]
    study = Study(
        config=params.config,
        factors=[Factor(**one) for one in params.factors],
        **{name: tables.read_table(given[name]) for name in TABLES},
        **audit,
        snr=answer_rows(snr),
        paper_snr=paper if 0 < len(paper) < len(snr) else None,
        mismatch=tables.read_table(given.mismatch) if given.get("mismatch") else None,
        screening=read_screening(given.screening),
        reevaluation=(
            read_reevaluation(given.reevaluation, given.after, params.factors, params.config["detectors"])
            if given.get("after")
            else None
        ),
        chosen=tables.read_table(given.chosen) if given.get("chosen") else None,
        direct=tables.read_table(given.direct) if given.get("direct") else None,
        loops={Path(file).parent.name: json.loads(Path(file).read_text()) for file in given.get("loop", [])},
        planted=json.loads(Path(given.truth).read_text()) if given.get("truth") else None,
        conclusions=[read_conclusion(one) for one in json.loads(Path(given.conclusion).read_text())],
        units={name: name_unit(detector, models.values()) for name, detector in detectors.items()},
        provenance=tell_provenance(),
        sources={
            robot: list(dict.fromkeys([model.source, *(entry.source for entry in model.effects)]))
            for robot, model in models.items()
        },
    )
    findings = read_findings(tables.read_table(given.findings))
    made = Path(given.conclusion).parent
    tables.write_text(made / "report.html", render_study(study, findings))
    show_answer(made, Path(snakemake.output.report).parent)
