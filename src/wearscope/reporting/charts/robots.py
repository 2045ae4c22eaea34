"""Chart of the robots' friction."""

import altair as alt
import pandas as pd

from wearscope.reporting.charts.base import Chart, Choice, Source
from wearscope.reporting.charts.encoding import add_zoom, named, tips
from wearscope.reporting.labels import words


def chart_friction(table: pd.DataFrame) -> Chart:
    """Friction of a joint over speed at several temperatures and wear levels."""
    unit = sorted(table["torque_unit"].unique())[0]
    tints = alt.Scale(range=["var(--c0)", "var(--c5)", "var(--c1)"])
    lines = named("friction").mark_line()
    drawn = lines.encode(
        x=alt.X(
            "speed:Q",
            title=f"joint speed [{table['speed_unit'].iloc[0]}]",
            scale=alt.Scale(type="log", nice=False),
            axis=alt.Axis(tickCount=5, format="~g"),
        ),
        y=alt.Y("torque:Q", title=f"friction torque [{unit}]", scale=alt.Scale(zero=False)),
        color=alt.Color("temperature:O", title="temperature [°C]", scale=tints),
        strokeDash=alt.StrokeDash("wear:O", title="wear"),
        tooltip=tips("speed:Q||.3; torque:Q||.4; temperature:O|temperature [°C]; wear:O"),
    )
    spec, fields = add_zoom(drawn.properties(width="container", height=320), "speed", "torque")
    return Chart(
        "friction",
        "Friction over speed",
        spec,
        {"friction": Source("friction", {"robot": "robot", "joint": "joint"})},
        "As the robot's model has it.",
        [Choice("joint", "Joint", [(name, words(name)) for name in table["joint"].unique()])],
        ["robot"],
        zoom=fields,
    )
