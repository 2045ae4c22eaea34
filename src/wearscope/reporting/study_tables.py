"""Tables of a study's page that are put together from several of its results."""

import pandas as pd
from markupsafe import Markup

from wearscope.reporting.page import render_table
from wearscope.reporting.study import Study


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
