"""Background of a study's answers: trust, the paper's findings, simulations, assumptions, provenance."""

from collections.abc import Sequence

import pandas as pd
import yaml
from markupsafe import Markup

from wearscope.reporting.charts.study import chart_friction
from wearscope.reporting.findings import PAPER_MODULES, Finding
from wearscope.reporting.labels import COLUMNS, join_words, unit_text, words
from wearscope.reporting.page import (
    badge,
    embed_chart,
    format_number,
    render_table,
    render_template,
)
from wearscope.reporting.study import Study

VERDICT_KINDS = {
    "agrees": "good", "partly": "unsure", "disagrees": "bad", "undecided": "unsure", "not asked": "neutral",
}  # fmt: skip


def render_trust(study: Study, sentences: Sequence[str]) -> Markup:
    """Chosen surrogates, sentences that the conclusion leaves out, failed points."""
    told = (
        (study.failed_simulations, "Every point whose simulation failed."),
        (study.failures, "Every cell and set at a point of which the detector failed."),
    )
    return render_template(
        "study/trust.html",
        chosen=_chosen(study),
        sentences=sentences,
        failures=[
            render_table(table.assign(cycle=table["cycle"].map(words)).rename(columns=COLUMNS), text)
            for table, text in told
            if len(table)
        ],
    )


def _chosen(study: Study) -> Markup:
    """The chosen surrogates by detector: kinds, fits, states."""
    if study.chosen is None:
        return Markup("")
    records, cells = [], []
    for fda, rows in study.chosen.groupby("fda", sort=True):
        cells.append({"fda": fda})
        records.append(
            {
                "detector": study.detector_name(str(fda)),
                "cells": _count_values(rows["state"]),
                "median fit [%]": float(rows["fit"].median()),
                "worst fit [%]": float(rows["fit"].min()),
                "median best possible [%]": float(rows["ceiling"].median()),
                "kinds": _count_values(rows["kind"]),
                "answer": "withheld" if fda in study.withheld() else "given",
            }
        )
    note = (
        "The surrogate chosen for each cell by cross-validation; its fit on runs that no choice saw. "
        "Best possible: the best fit that the noise of a run allows."
    )
    return render_table(records, note, cells=cells)


def _count_values(column: pd.Series) -> str:
    """``3 reached, 1 short``."""
    return ", ".join(f"{n} {words(value)}" for value, n in column.value_counts().items())


def render_findings(findings: Sequence[Finding]) -> Markup:
    """The paper's findings compared with this study's; empty where the study asked none of its questions."""
    asked = [
        {"verdict": badge(one.verdict, VERDICT_KINDS[one.verdict]), "the paper": one.paper}
        | {"this study": one.here}
        for one in findings
        if one.verdict != "not asked"
    ]
    return render_template("study/paper.html", findings=render_table(asked)) if asked else Markup("")


def render_simulated(study: Study) -> Markup:
    """The robots' friction, and what was assumed."""
    return render_template(
        "study/simulated.html",
        friction=embed_chart(chart_friction(study.friction)) if study.friction is not None else "",
        assumptions=_assumptions(study),
    )


def _assumptions(study: Study) -> list[tuple[str, str]]:
    """Assumptions: pairs of a subject and one or two sentences."""
    own = [name for module in PAPER_MODULES.values() if (name := study.detector_of(module)) is not None]
    told = f"The paper's are confidential; {study.join_detectors(own)} follow its description."
    detectors = [("Detectors", told)] if own else []
    robots = []
    for robot, texts in study.sources.items():  # a source that several numbers share is named once
        parts = dict.fromkeys(part.strip() for text in texts for part in text.split(";"))
        robots.append((f"Robot {robot}", "; ".join(filter(None, parts))))
    levels = "; ".join(
        f"{one.description}, {one.low:g} to {one.high:g} {unit_text(one.unit)}".strip()
        for one in study.factors
    )
    snr, scope = study.config["snr"], study.config["scope"]
    facts = {
        "Factors": f"{levels}. Each is constant within a test-cycle; temperature is the same in every joint. "
        "The controller believes in the declared payload mass; the robot carries it over (1 + error).",
        "Distribution of the factors": "Normal about the middle of each range; a coded unit is a quarter of "
        f"the range. SNR: all factors vary at once, σ = {snr['sigma']:g}, wear from {snr['f0']:g} to "
        f"{snr['f0'] + snr['delta']:g}. Scope: one factor varies, the others are nominal, wear from "
        f"{scope['f0']:g}. Beyond ±2, the ends of a range, nothing was simulated.",
        "Extrapolation to nominal": _extrapolation(study),
        "Intervals": "95 %. Those of medians, ranks and differences are bootstraps over the cells. Shares "
        "have Wilson intervals. Those of the surrogates assume independent normal residuals.",
        "Reality": "All is simulated. Only measured data say how well, see the closed loop.",
    }
    signed = [(name, text.replace(" -", " −")) for name, text in facts.items()]
    return [*detectors, *robots, *signed]


def _extrapolation(study: Study) -> str:
    rows = study.checks[study.checks["model"] == study.config["scope"]["model"]]
    if study.config["scope"]["model"] == "chosen":
        return "None: the chosen surrogates learn from runs at nominal and along the scope's lines."
    if rows.empty:
        return "Not known: the design has no check for the surrogate."
    row = rows.iloc[0]
    where = "outside" if row["nominal_outside"] else "within"
    there, centre = (format_number(float(row[f"variance_{name}"])) for name in ("nominal", "centre"))
    return (
        f"The scope starts from nominal, {where} the design region. The prediction variance there is {there} "
        f"of a run's, and {centre} at the centre."
    )


def render_provenance(study: Study) -> Markup:
    """Facts, configuration, packages."""
    facts = {name: value for name, value in study.provenance.items() if not isinstance(value, dict)}
    rows = [{"what": name, "value": "n/a" if one is None else str(one)} for name, one in facts.items()]
    packages = study.provenance.get("packages") or {}
    return render_template(
        "study/provenance.html",
        facts=render_table(rows) if rows else "",
        configuration=yaml.safe_dump(dict(study.config), sort_keys=False, allow_unicode=True),
        packages=join_words([f"{name} {one}" for name, one in packages.items()]),
    )
