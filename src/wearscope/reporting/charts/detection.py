"""Chart of detectors on recordings: simulated and recorded test quantities of all cells on one axis."""

from typing import Any

import altair as alt
import numpy as np
import pandas as pd

from wearscope.reporting.charts.base import Chart, Source
from wearscope.reporting.charts.encoding import named, tips
from wearscope.reporting.charts.factors import SYMLOG, symlog_axis
from wearscope.reporting.detection import Detections

KINDS = {
    "simulated": ("simulated, no wear", "var(--soft)"),
    "simulated_worn": ("simulated, worn", "var(--c4)"),
    "nominal": ("recorded, nominal", "var(--after)"),
    "judged": ("recorded, judged", "var(--before)"),
}
_CELL = ["motion", "joint", "fda"]


def axis_tables(found: Detections) -> dict[str, pd.DataFrame]:
    """Simulated spans and recorded points: 0 is the median without wear, 1 the alarm threshold.

    ``spans``: 95 % of the runs and their quartiles; ``points``: one recording each. Cells without a threshold
    have none.
    """
    cells = found.thresholds[[*_CELL, "threshold", "unit"]].set_index(_CELL)
    unworn = found.simulated[found.simulated["kind"] == "simulated"]
    cells["middle"] = unworn.groupby(_CELL)["y"].median()
    cells = cells[np.isfinite(cells[["threshold", "middle"]].astype(float)).all(axis=1)].reset_index()

    def scale(rows: pd.DataFrame) -> pd.DataFrame:
        own = rows[rows["kind"].isin(KINDS)].merge(cells, on=_CELL, suffixes=("", "_of_cell"))
        place = (own["y"] - own["middle"]) / (own["threshold_of_cell"] - own["middle"])
        own = own.assign(place=place, cell=own["joint"] + ", " + own["fda"], unit=own["unit_of_cell"])
        return own.assign(kind=own["kind"].map({key: text for key, (text, _) in KINDS.items()}))

    missing = {"threshold": np.nan, "unit": ""}
    simulated = scale(found.simulated.assign(**missing))
    levels = {"low": 0.025, "first": 0.25, "third": 0.75, "high": 0.975}
    by = simulated.groupby([*_CELL, "cell", "kind"], sort=False)["place"]
    spans = pd.DataFrame({name: by.quantile(level) for name, level in levels.items()}).reset_index()
    points = scale(found.detection)[[*_CELL, "cell", "kind", "run", "place", "y", "unit", "verdict"]]
    return {"points": points, "spans": spans}


def chart_axis() -> Chart:
    """Test quantities by cell and kind."""
    names, tints = zip(*KINDS.values(), strict=True)
    title = "0: healthy in simulation, 1: alarm threshold"
    x = alt.X("place:Q", title=title, scale=SYMLOG, axis=symlog_axis((1, 3)))
    look: dict[str, Any] = {
        "y": alt.Y("cell:N", title=None, sort=None, axis=alt.Axis(labelLimit=200)),
        "yOffset": alt.YOffset("kind:N", scale=alt.Scale(domain=list(names))),
        "color": alt.Color("kind:N", title=None, scale=alt.Scale(domain=list(names), range=list(tints))),
    }
    told = tips("cell:N; kind:N; low:Q|95 % from|.3; first:Q|half from|.3; third:Q|to|.3; high:Q|95 % to|.3")
    spans = named("spans").encode(**look, tooltip=told)
    rule = alt.Chart(alt.InlineData([{"place": 1}])).mark_rule(strokeDash=[5, 4], color="var(--bad)")
    points = named("points").mark_circle(size=45, opacity=0.8)
    layers = (
        spans.mark_rule(strokeWidth=2).encode(x=alt.X("low:Q"), x2="high:Q"),
        spans.mark_rule(strokeWidth=6, opacity=0.6).encode(x=alt.X("first:Q"), x2="third:Q"),
        points.encode(x=x, **look, tooltip=tips("run:N|recording; cell:N; verdict:N; y:Q||.4; unit:N")),
        rule.encode(x="place:Q"),
    )
    by = {"motion": "motion", "joint": "joint", "fda": "fda"}
    return Chart(
        "axis-chart",
        "Machine and simulator on one axis",
        alt.layer(*layers).properties(width="container", height={"step": 8}),
        {"points": Source("points", by), "spans": Source("spans", by)},
        "Each joint and detector, scaled so that 1 is its alarm threshold (dashed). Bars: 95 % of the "
        "simulated runs, and half of them. Points: recordings; a nominal one is judged by detectors that are "
        "fitted to the others.",
        single=["motion"],
    )
