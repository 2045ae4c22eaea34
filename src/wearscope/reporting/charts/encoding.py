"""Parts of the pages' Altair charts: data by name, axes, colours, zoom and tooltips."""

import json
from collections.abc import Mapping
from typing import Any

import altair as alt


def named(name: str) -> alt.Chart:
    """Chart without marks, on the data that a source names."""
    return alt.Chart(alt.NamedData(name))


def symlog(field: str, title: str) -> alt.X:
    """Horizontal axis, logarithmic beyond ±1: 0, ±0.5, and 1, 2 and 5 times powers of ten on both sides."""
    sizes = [0.5, *(step * 10**power for power in range(7) for step in (1, 2, 5))]
    axis = alt.Axis(
        values=[*(-size for size in reversed(sizes)), 0, *sizes], format=",.2~r", labelOverlap="greedy"
    )
    return alt.X(field, title=title, scale=alt.Scale(type="symlog", constant=1), axis=axis)


def rows(field: str, limit: int = 200) -> alt.Y:
    """Vertical axis with one row per name, in the table's order."""
    return alt.Y(field, title=None, sort=None, axis=alt.Axis(labelLimit=limit))


def detector_rows(names: Mapping[str, str]) -> alt.Y:
    """Vertical axis with one row per detector, labelled with its full name."""
    return alt.Y("fda:N", title=None, axis=alt.Axis(labelExpr=_name_labels(names), labelLimit=220))


def detector_axis(names: Mapping[str, str]) -> alt.Axis:
    """Axis on top with the detectors' names, one word per line, or their letters where it is narrow."""
    lines = max((name.count(" ") for name in names.values()), default=0)
    narrow = f"width < {75 * len(names)}"
    expression = f"{narrow} ? datum.label : split({_name_labels(names)}, ' ')"
    room = alt.expr(f"{narrow} ? 4 : {4 + 15 * lines}")
    return alt.Axis(orient="top", labelAngle=0, labelExpr=expression, labelPadding=room)


def offset(field: str, values: Any) -> alt.YOffset:
    """Vertical offset within a row that draws each value of a field on a line of its own."""
    return alt.YOffset(field, scale=alt.Scale(domain=list(values)))


def tint(field: str, tints: Mapping[str, str], **options: Any) -> alt.Color:
    """Colour of each value of a field; the legend has the same order."""
    scale = alt.Scale(domain=list(tints), range=list(tints.values()))
    return alt.Color(field, **{"title": None} | options, scale=scale)


def detector_tint(names: Mapping[str, str]) -> alt.Color:
    """Colour by detector, the same on all charts; the legend names them."""
    told = alt.Legend(labelExpr=_name_labels(names), symbolOpacity=1)
    return alt.Color("fda:N", title="detector", scale=alt.Scale(domain=list(names)), legend=told)


def _name_labels(names: Mapping[str, str]) -> str:
    """Expression that shows values of an axis or legend by their names."""
    return f"({json.dumps(dict(names))})[datum.label] || datum.label"


def add_zoom(chart: Any, x: str = "", y: str = "") -> tuple[Any, dict[str, str]]:
    """Chart whose scales zoom (Ctrl and wheel, pinch, buttons) and move (mouse), and each field's scale.

    Parameters
    ----------
    chart : altair chart
    x, y : str
        Field on the axis; empty where it does not zoom.
    """
    fields = {field: scale for field, scale in ((x, "x"), (y, "y")) if field}
    zoom = alt.selection_interval(
        name="zoom",
        bind="scales",
        encodings=[scale for scale in ("x", "y") if scale in fields.values()],
        zoom="wheel![event.ctrlKey]",
        translate="[pointerdown[event.pointerType == 'mouse'], window:pointerup] > window:pointermove!",
    )
    return chart.add_params(zoom), fields


def tips(text: str) -> list[alt.Tooltip]:
    """Tooltips from a text ``field|title|format; ...``; title and format may be left out.

    >>> [one["title"] for one in tips("snr:Q|SNR|.3; robot:N")][0]
    'SNR'
    """
    found = []
    for one in text.split(";"):
        field, title, form = [*map(str.strip, one.split("|")), "", ""][:3]
        found.append(alt.Tooltip(field, title=title or alt.Undefined, format=form or alt.Undefined))
    return found


def cell_tips(text: str) -> list[alt.Tooltip]:
    """Tooltips that name a cell (robot, test-cycle, axis, detector), then those of `text`."""
    return tips(f"robot:N; cycle:N|test-cycle; axis:N; fda:N|detector; {text}")
