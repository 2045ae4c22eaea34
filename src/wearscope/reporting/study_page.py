"""The report of a study: one page with a conclusion, answers to the three questions, interactive charts.

Below the answers is their background: the paper's findings, simulations, assumptions, provenance.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import yaml
from markupsafe import Markup

from wearscope.evaluation.conclusion import Conclusion
from wearscope.reporting.charts.study import (
    chart_friction,
    chart_reach,
    chart_response,
    chart_roc,
    chart_scope,
    chart_snr,
    chart_snr_cells,
    chart_weights,
    detection_cases,
    study_filters,
    study_labels,
    study_tables,
)
from wearscope.reporting.findings import PAPER_MODULES, Finding
from wearscope.reporting.labels import (
    COLUMNS,
    MODEL_NAMES,
    count_text,
    factor_name,
    join_words,
    quantity_text,
    unit_text,
    with_unit,
    words,
)
from wearscope.reporting.loop_words import conclude_loop, tell_planted
from wearscope.reporting.page import (
    Section,
    badge,
    describe_study,
    embed_chart,
    format_number,
    interval_text,
    render_page,
    render_table,
    render_template,
)
from wearscope.reporting.reevaluation_page import count_truth, draw_change, snr_sides, tell_headline
from wearscope.reporting.study import Study
from wearscope.reporting.study_words import (
    best_detector,
    count_failed,
    doubts,
    dropped_factors,
    effective_scope,
    failed_simulations,
    friction_rise,
    qualify,
    reach_of_shifts,
    recommendations,
    relevant_factors,
    study_strip,
    tell_cell,
    tell_mismatch,
    tell_snr,
    tell_trust,
    thresholds_of,
)

DEMONSTRATION = "twin"
#: Largest number of sentences on a card; the section below has the others.
MOST = 2


def render_study(study: Study, findings: Sequence[Finding]) -> str:
    """Report of a study as one self-contained page.

    Parameters
    ----------
    study : Study
    findings : sequence of Finding
        From `wearscope.reporting.findings.compare_with_paper`.
    """
    tables, config = study_tables(study), study.config
    if study.reevaluation is not None:
        tables["sides"] = snr_sides(study.reevaluation)
    told = {
        "q1": relevant_factors(study),
        "q2": best_detector(study),
        "q3": effective_scope(study),
        "trust": tell_trust(study),
    }
    rest = {name: sentences[MOST:] for name, sentences in told.items()}
    sections = [
        Section("Conclusion", _summarise(study, told), "summary"),
        Section("Which factors matter?", _factors(study, rest["q1"]), "q1"),
        Section("Which detector is best?", _detectors(study, rest["q2"]), "q2"),
        Section("Where does it work?", _scope(study, rest["q3"]), "q3"),
        Section("Can it be trusted?", render_trust(study, rest["trust"]), "trust"),
        Section("The closed loop", _loops(study), "loops"),
        Section("What the correction changes", _correction(study), "correction"),
        Section("Compared with the paper", render_findings(findings), "paper"),
        Section("What was simulated", render_simulated(study), "simulated"),
        Section("Provenance", render_provenance(study), "provenance"),
    ]
    return render_page(
        f"Study {config['study']}",
        sections,
        f"{describe_study(config, len(config['robots']))}; {count_text(len(study.snr), 'cell')} (each a "
        "robot, test-cycle, axis and detector)",
        "Made by wearscope from its tables.",
        study_filters(study),
        tables,
        study_labels(study),
        study_strip(study),
        embed_chart(chart_reach(study, reach_of_shifts(study))) if study.conclusions else "",
    )


def _first(study: Study) -> dict[str, str]:
    """Filter value of charts that show only one detector: the recommended one comes first."""
    return {"fda": study.recommended()} if study.recommended() else {}


def _summarise(study: Study, told: Mapping[str, Sequence[str]]) -> Markup:
    """Points that the conclusion leaves open, then the first sentences of each answer."""
    cards = [
        (title, told[name][:MOST], name, more)
        for title, name, more in (
            ("Which factors matter?", "q1", "Every factor and cell"),
            ("Which detector is best?", "q2", "Every cell"),
            ("Where does it work?", "q3", "Scope, ROC, thresholds"),
            ("Can it be trusted?", "trust", "Fits, audit, assumptions"),
        )
    ]
    open_points = qualify(study) if study.conclusions else []
    note = (
        "Each robot by itself. Ranges hold 95 % of a factor that varies alone; ≥: the end of what was "
        "simulated. As friction: its rise at a tenth of the joints' top speeds. Median SNR of the detector "
        "to use, with its 95 % interval."
    )
    robots = [_compare(study, one) for one in study.conclusions if one.robot]
    return render_template(
        "study/summary.html",
        qualifiers=[*open_points, *count_failed(study)],
        alarms=[*dropped_factors(study), *doubts(study), *failed_simulations(study)],
        cards=cards,
        robots=render_table(robots, note, filter_by={"robot": "robot"}) if robots else "",
    )


def _compare(study: Study, one: Conclusion) -> dict[str, Any]:
    """A robot's row in the table of robots side by side."""
    found = not np.isnan(one.wear)
    row: dict[str, Any] = {
        "robot": one.robot,
        "detector to use": study.detector_name(one.detector) if one.detector else "none",
        "finds wear from": quantity_text(one.wear, study.factor("f").unit) if found else "not found",
    }
    rise = friction_rise(study, one.wear, one.robot) if found else None
    row["as friction"] = f"+{100 * rise[0]:.2g} to {100 * rise[1]:.2g} %" if rise else "n/a"
    bounds = {bound.factor: bound for bound in one.bounds}
    for name in study.config["scope"]["factors"]:
        factor, bound = study.factor(name), bounds.get(name)
        size = f"±{quantity_text(1.96 * bound.sigma, factor.unit)}" if bound else "n/a"
        row[f"tolerates {factor_name(factor)}"] = f"≥ {size}" if bound and bound.largest else size
    values = thresholds_of(study, one)["threshold"].dropna()
    ends = f"{format_number(values.min())} to {format_number(values.max())}"
    ends = f"{ends} {unit_text(study.units.get(one.detector, ''))}".strip()
    row["alarm threshold"] = ends if len(values) else "n/a"
    row["median SNR"] = "n/a"
    if study.rankings is not None:
        table = study.rankings.set_index(["robot", "fda"])[["median", "median_low", "median_high"]]
        if (one.robot, one.detector) in table.index:
            row["median SNR"] = interval_text(*table.loc[(one.robot, one.detector)])
    return row | {"cells": f"{one.cells_sure} of {one.cells}"}


def _factors(study: Study, sentences: Sequence[str]) -> Markup:
    """Section on Q-1: sentences that its card leaves out, coefficients, responses."""
    responses = [chart_response(study, _first(study))] if study.responses is not None else []
    return render_template(
        "study/factors.html",
        sentences=sentences,
        model=MODEL_NAMES[study.config["sensitivity"]["model"]],
        charts=embed_chart(chart_weights(study), *responses),
    )


def _detectors(study: Study, sentences: Sequence[str]) -> Markup:
    """Section on Q-2: sentences that its card leaves out, setting, charts, ranking, SNR by source."""
    setting, fault = study.config["snr"], study.factor("f")
    ends = (setting["f0"], setting["f0"] + setting["delta"])
    low, high = (float(fault.to_natural(one)) for one in ends)
    shown, cells = study.ranking.drop(columns="interval_from", errors="ignore"), []
    if "fda" in shown:
        cells = shown[["fda"]].to_dict("records")
        shown = shown.assign(fda=shown["fda"].map(study.detector_name))
    return render_template(
        "study/detectors.html",
        sentences=sentences,
        setting=f"Signal: wear from {low:g} to {high:g}. Noise: every other factor varies with a standard "
        f"deviation of {25 * setting['sigma']:.2g} % of its range",
        charts=embed_chart(chart_snr(study), chart_snr_cells(study)),
        ranking=render_table(shown.rename(columns=COLUMNS), cells=cells),
        sources=_sources(study),
    )


def _sources(study: Study) -> Markup:
    """The SNR of each detector by its source, with intervals; nothing where there is only one."""
    told = {
        fda: {"detector": study.detector_name(fda), "median, chosen surrogate": median}
        for fda, median in study.snr.groupby("fda", sort=True)["snr_exact"].median().items()
    }
    note = "Signal-to-noise ratio by how it was computed."
    if study.paper_snr is not None:
        for fda, median in study.paper_snr.groupby("fda")["snr_exact"].median().items():
            told[fda]["median, the paper's model (3)"] = median
    if study.direct is not None and len(study.direct):
        for row in study.direct.itertuples():
            told[row.fda]["surrogate, one cell"] = tell_snr(row, "surrogate")
            told[row.fda]["simulated directly, one cell"] = tell_snr(row, "direct")
        note += (
            f" One cell: {tell_cell(study.direct.iloc[0])}, with the noise of single runs. Where its two "
            "intervals do not overlap, the direct value is the answer."
        )
    if study.mismatch is not None and len(study.mismatch):
        for row in study.mismatch.itertuples():
            told[row.fda]["robot differs from model"] = tell_snr(row, "mismatch")
        note += f" The robot that differs from the detectors' model has {tell_mismatch(study)}."
    if all(len(one) < 3 for one in told.values()):
        return Markup("")
    return render_table(pd.DataFrame(told.values()), note, cells=[{"fda": fda} for fda in told])


def _scope(study: Study, sentences: Sequence[str]) -> Markup:
    """Section on Q-3: sentences that its card leaves out, scope, ROC, thresholds."""
    charts = [chart_scope(study, _first(study))]
    if study.detection is not None:
        charts.append(chart_roc(study, detection_cases(study)[1]))
    asked = recommendations(study) if study.conclusions else []
    found = [thresholds_of(study, one) for one in asked if one.detector]
    table = pd.concat(found, ignore_index=True) if found else None
    return render_template(
        "study/scope.html",
        sentences=sentences,
        charts=embed_chart(*charts),
        thresholds=_thresholds(study, table) if table is not None and len(table) else "",
        count=0 if table is None else len(table),
    )


def _thresholds(study: Study, table: pd.DataFrame) -> Markup:
    units = {study.units.get(one, "") for one in table["fda"]}
    unit = units.pop() if len(units) == 1 else ""
    note = (
        "The largest threshold that any varying factor needs. It keeps the study's false-alarm rate for "
        "variations up to those of the conclusion."
    )
    return render_table(
        table.assign(cycle=table["cycle"].map(words)),
        note,
        digits=4,
        filter_by={"robot": "robot", "test-cycle": "cycle", "axis": "axis", "detector": "fda"},
        columns=f"robot; cycle|test-cycle; axis; fda|detector; threshold|{with_unit('threshold', unit)}",
    )


def _loops(study: Study) -> Markup:
    """Conclusion of each closed loop of the study; details are on the loop's own page."""
    loops = []
    for name, verdict in study.loops.items():
        known = study.planted if name == DEMONSTRATION else None
        one = {"title": f"Closed on {name}", "sentences": [conclude_loop(verdict)[1]], "folder": "../"}
        if known is not None:
            one["title"] = "Demonstration: a simulated twin with an effect that its model lacks"
            one |= {"sentences": [*one["sentences"], tell_planted(verdict, known)], "folder": ""}
        loops.append(one | {"page": f"{one['folder']}closed_loop/{name}/report.html"})
    return render_template("study/loops.html", loops=loops)


def _correction(study: Study) -> Markup:
    """Changes in the study's answers by a corrected model; details are on the correction's own page."""
    one = study.reevaluation
    if one is None:
        return Markup("")
    told = [tell_headline(one), count_truth(one)]
    return render_template("study/correction.html", told=told, chart=draw_change(one))


VERDICT_KINDS = {
    "agrees": "good", "partly": "unsure", "disagrees": "bad", "undecided": "unsure", "not asked": "neutral",
}  # fmt: skip


def render_trust(study: Study, sentences: Sequence[str]) -> Markup:
    """Section on trust: chosen surrogates, sentences that its card leaves out, failed points."""
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
    """Section on what was simulated: the robots' friction, and what was assumed."""
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
    """Section on provenance: facts of the run, its configuration, versions of packages."""
    facts = {name: value for name, value in study.provenance.items() if not isinstance(value, dict)}
    rows = [{"what": name, "value": "n/a" if one is None else str(one)} for name, one in facts.items()]
    packages = study.provenance.get("packages") or {}
    return render_template(
        "study/provenance.html",
        facts=render_table(rows) if rows else "",
        configuration=yaml.safe_dump(dict(study.config), sort_keys=False, allow_unicode=True),
        packages=join_words([f"{name} {one}" for name, one in packages.items()]),
    )
