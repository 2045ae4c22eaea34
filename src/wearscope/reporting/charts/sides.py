"""A number of each thing on two or three sides: studies, loops, models before and after."""

from collections.abc import Sequence

import altair as alt
import pandas as pd

from wearscope.reporting.charts.base import Chart, Source
from wearscope.reporting.charts.encoding import named, tips
from wearscope.reporting.charts.factors import SYMLOG, symlog_axis

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
    scale = alt.Scale(domain=list(names), range=list(_TINTS[: len(names)]))
    base = named("sides").encode(
        y=alt.Y("thing:N", title=None, sort=None, axis=alt.Axis(labelLimit=220)),
        yOffset=alt.YOffset("side:N", scale=alt.Scale(domain=list(names))),
        color=alt.Color("side:N", title=None, scale=scale, legend=alt.Legend(labelLimit=260, columns=1)),
        tooltip=tips(f"thing:N|{thing}; side:N|in; value:Q|{quantity}|.4; low:Q|95 % from|.4; high:Q|to|.4"),
    )
    x = alt.X("value:Q", title=quantity, scale=SYMLOG, axis=symlog_axis((1, 3)))
    spans = base.transform_filter("isValid(datum.low)").mark_rule(strokeWidth=4, opacity=0.4)
    layers = [spans.encode(x=alt.X("low:Q"), x2="high:Q"), base.mark_circle(size=70, opacity=1).encode(x=x)]
    return Chart(
        "sides-chart",
        title,
        alt.layer(*layers).properties(width="container", height={"step": 14}),
        {"sides": Source("sides")},
        caption,
    )
