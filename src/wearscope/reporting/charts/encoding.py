"""Altair charts as the pages have them: their data by name, zoom, cells under the pointer, colours."""

import json
from collections.abc import Mapping
from typing import Any

import altair as alt


def named(name: str) -> alt.Chart:
    """Empty chart of one of a chart's sources."""
    return alt.Chart(alt.NamedData(name))


def add_zoom(chart: Any, x: str = "", y: str = "") -> tuple[Any, dict[str, str]]:
    """Chart whose scales zoom (Ctrl and wheel, pinch, buttons) and move (mouse), and the fields that do.

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
    """What the pointer tells: ``field|title|format``, separated by semicolons.

    >>> [one["title"] for one in tips("snr:Q|SNR|.3; robot:N")][0]
    'SNR'
    """
    found = []
    for one in text.split(";"):
        field, title, form = [*map(str.strip, one.split("|")), "", ""][:3]
        found.append(alt.Tooltip(field, title=title or alt.Undefined, format=form or alt.Undefined))
    return found


def cell_tips() -> list[alt.Tooltip]:
    """What the pointer tells of a cell."""
    return tips("robot:N; cycle:N|test-cycle; axis:N; fda:N|detector")


def colour(names: Mapping[str, str], legend: bool = True) -> dict[str, Any]:
    """Keyword arguments of a colour by detector, the same on all charts; the legend names them."""
    return {
        "type": "nominal",
        "title": "detector",
        "scale": alt.Scale(domain=list(names)),
        "legend": alt.Legend(labelExpr=name_labels(names), symbolOpacity=1) if legend else None,
    }


def name_labels(names: Mapping[str, str]) -> str:
    """Expression that shows values of an axis or legend by their names."""
    return f"({json.dumps(dict(names))})[datum.label] || datum.label"
