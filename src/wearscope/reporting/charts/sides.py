"""A number of each thing on two or three sides: studies, loops, models before and after."""

from collections.abc import Sequence

import altair as alt
import pandas as pd

from wearscope.reporting.charts.base import Chart, Source
from wearscope.reporting.charts.encoding import named, offset, rows, symlog, tint, tips

_TINTS = ("var(--before)", "var(--after)", "var(--ink)")


def side_table(sides: dict[str, pd.DataFrame], thing: str, value: str) -> pd.DataFrame:
    """Rows of all sides: ``side``, ``thing``, ``value``, ``low``, ``high``; its ends where a side has them.

    Parameters
    ----------
    sides : mapping of str to DataFrame
        By name; the ends of a value's interval are called ``<value>_low`` and ``<value>_high``.
    thing, value : str
        Columns.
    """
    names = {thing: "thing", value: "value", f"{value}_low": "low", f"{value}_high": "high"}
    parts = [
        frame.reindex(columns=list(names)).rename(columns=names).assign(side=side)
        for side, frame in sides.items()
    ]
    return pd.concat(parts, ignore_index=True).astype({"value": float, "low": float, "high": float})


def chart_sides(names: Sequence[str], title: str, quantity: str, thing: str, caption: str) -> Chart:
    """Values of the table ``sides`` (see `side_table`), with their intervals where there are some."""
    tints = dict(zip(names, _TINTS, strict=False))
    base = named("sides").encode(
        y=rows("thing:N", 220),
        yOffset=offset("side:N", names),
        color=tint("side:N", tints, legend=alt.Legend(labelLimit=260, columns=1)),
        tooltip=tips(f"thing:N|{thing}; side:N|in; value:Q|{quantity}|.4; low:Q|95 % from|.4; high:Q|to|.4"),
    )
    spans = base.transform_filter("isValid(datum.low)").mark_rule(strokeWidth=4, opacity=0.4)
    points = base.mark_circle(size=70, opacity=1).encode(x=symlog("value:Q", quantity))
    spec = alt.layer(spans.encode(x="low:Q", x2="high:Q"), points)
    spec = spec.properties(width="container", height={"step": 14})
    return Chart("sides-chart", title, spec, {"sides": Source("sides")}, caption)
