"""What stands behind the answers: trust, the paper, what was simulated and assumed, costs, provenance."""

from typing import Any

import pandas as pd
import yaml
from markupsafe import Markup

from wearscope.reporting import trust
from wearscope.reporting.assumptions import list_assumptions
from wearscope.reporting.charts.robots import chart_friction, chart_motion
from wearscope.reporting.charts.trust import chart_fits
from wearscope.reporting.labels import COLUMNS, join_words
from wearscope.reporting.page import badge, embed_figure, render_table
from wearscope.reporting.sections.base import StudySection, embed_charts, say
from wearscope.reporting.study import Study

VERDICT_KINDS = {
    "agrees": "good", "partly": "unsure", "disagrees": "bad", "undecided": "unsure", "not asked": "neutral",
}  # fmt: skip


def name_columns(table: pd.DataFrame) -> pd.DataFrame:
    """A table of failures in words."""
    shown = table.assign(cycle=table["cycle"].str.replace("_", " "))
    return shown.rename(columns=COLUMNS)


def render_chosen(study: Study) -> Markup:
    """The chosen surrogates by detector: kinds, fits, states."""
    if study.chosen is None:
        return Markup("")
    records = []
    for fda, rows in study.chosen.groupby("fda", sort=True):
        states, kinds = rows["state"].value_counts(), rows["kind"].value_counts()
        records.append(
            {"detector": fda, "cells": len(rows)}
            | {state: int(states.get(state, 0)) for state in ("reached", "at ceiling", "short", "constant")}
            | {
                "median fit [%]": float(rows["fit"].median()),
                "worst fit [%]": float(rows["fit"].min()),
                "median ceiling [%]": float(rows["ceiling"].median()),
                "kinds": ", ".join(f"{str(kind).replace('_', ' ')} {n}" for kind, n in kinds.items()),
                "answer": "withheld" if fda in study.withheld() else "given",
            }
        )
    note = (
        "The surrogate chosen for each cell by cross-validation, its fit on runs that no choice saw; "
        "ceiling: what the noise of a run, known from replicates, leaves."
    )
    return render_table(pd.DataFrame(records), note, filter_by={"detector": "fda"})


class Trust(StudySection):
    """Fits, audit, direct simulation, failed points, the design."""

    title, anchor, template = "Can it be trusted?", "trust", "study/trust.html"

    def context(self) -> dict[str, Any]:
        """Sentences, charts, tables."""
        study = self.study
        columns = ["model", "points", "terms", "rank", "condition", "dof", "resolution", "variance_centre"]
        checks = study.checks[[*columns, "variance_nominal", "nominal_outside"]]
        failed = [*trust.failed_simulations(study), trust.failed_points(study)]
        return {
            "quality": say([trust.surrogate_quality(study)]),
            "fits": embed_charts([chart_fits(study)]),
            "chosen": render_chosen(study),
            "audited": say(
                [*trust.audit_outcome(study), *trust.direct_outcome(study), *trust.mismatch_outcome(study)]
            ),
            "failed": say(failed),
            "failures": [
                render_table(name_columns(table), text)
                for table, text in (
                    (study.failed_simulations, "Every point whose simulation failed."),
                    (study.failures, "Every cell and set at a point of which the detector failed."),
                )
                if len(table)
            ],
            "design": render_table(
                checks, "The design, checked before anything was simulated; variances in σ² of a run."
            ),
        }


class Paper(StudySection):
    """What the paper found, compared with this study; only what the study asked."""

    title, anchor, template = "Compared with the paper", "paper", "study/paper.html"

    def context(self) -> dict[str, Any]:
        """Findings that were asked; nothing where none was."""
        asked = [one for one in self.findings if one.verdict != "not asked"]
        table = [
            {
                "verdict": badge(one.verdict, VERDICT_KINDS[one.verdict]),
                "the paper": one.paper,
                "this study": one.here,
            }
            for one in asked
        ]
        return {"findings": render_table(table)} if table else {}


_RECORDING = (
    "Position, speed and motor torque of one joint in two runs that differ in wear.",
    "What a drive records and a detector sees: two runs of one robot and test-cycle.",
)


class Simulated(StudySection):
    """The robots: motion, friction, recordings."""

    title, anchor, template = "What was simulated", "simulated", "study/simulated.html"

    def context(self) -> dict[str, Any]:
        """Charts and the figure of two recordings."""
        study = self.study
        return {
            "motion": embed_charts([chart_motion(study)] if study.postures is not None else []),
            "friction": embed_charts([chart_friction(study)] if study.friction is not None else []),
            "recording": embed_figure(study.figures["recording"], *_RECORDING)
            if "recording" in study.figures
            else "",
            "assumptions": list_assumptions(study),
        }


class Provenance(StudySection):
    """Costs, versions, configuration."""

    title, anchor, template = "Costs and provenance", "provenance", "study/provenance.html"

    def context(self) -> dict[str, Any]:
        """Costs by stage, facts, configuration, packages."""
        study = self.study
        costs = study.costs.sort_values("seconds", ascending=False, kind="stable").rename(
            columns={"seconds": "seconds, all jobs", "memory": "largest job [MiB]"}
        )
        facts = {name: value for name, value in study.provenance.items() if not isinstance(value, dict)}
        rows = pd.DataFrame(
            {"what": list(facts), "value": ["n/a" if v is None else str(v) for v in facts.values()]}
        )
        packages = study.provenance.get("packages") or {}
        return {
            "costs": render_table(costs) if len(costs) else "",
            "facts": render_table(rows) if len(rows) else "",
            "configuration": yaml.safe_dump(dict(study.config), sort_keys=False, allow_unicode=True),
            "packages": join_words([f"{name} {one}" for name, one in packages.items()]),
        }
