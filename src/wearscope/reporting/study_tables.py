"""Tables of a study's page that are put together from several of its results."""

import pandas as pd
from markupsafe import Markup

from wearscope.reporting.costs import PAPER
from wearscope.reporting.labels import count_text
from wearscope.reporting.page import render_table
from wearscope.reporting.study import Study


def render_speed(study: Study) -> Markup:
    """The paper's costs and this study's."""
    config = study.config
    points = 2 * int(study.checks["points"].iloc[0]) + config["simulation"]["nominal_runs"]
    if study.chosen is not None and len(study.chosen):
        asked, axes = config["surrogates"]["filling"], len(config["axes"])
        points += asked["points"] + asked["replicates"] + asked["checking_points"]
        points += axes * (asked["question_points"] + asked["checking_question_points"])
    runs = len(config["robots"]) * len(config["cycles"]) * points
    if study.direct is not None:
        runs += 2 * config["direct"]["runs"]
    if study.audit is not None:
        runs += len(study.audit[["robot", "cycle", "point"]].drop_duplicates())
    seconds = dict(zip(study.costs["stage"], study.costs["seconds"], strict=True))
    what = {
        "simulate_points": ("540 simulations", count_text(runs, "simulation")),
        "compute_snr": ("SNR of 108 cells", f"SNR of {count_text(len(study.snr), 'cell')}"),
        "compute_scope": (
            "scope of 108 cells",
            f"scope of {count_text(len(study.snr), 'cell')}, both methods",
        ),
    }
    table = pd.DataFrame(
        {
            "the paper": [paper for paper, _ in what.values()],
            "took [s]": [PAPER[stage] for stage in what],
            "this study": [here for _, here in what.values()],
            "jobs took [s]": [float(seconds.get(stage, float("nan"))) for stage in what],
        }
    )
    return render_table(table, "Costs, each on its own computer; n/a: there is no timing with the results.")


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
