"""Charts of what was simulated: the robots' friction and their motion through the test-cycles."""

from typing import Any

import altair as alt
import numpy as np
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


def chart_motion(table: pd.DataFrame) -> Chart:
    """A robot moving through a test-cycle, seen from a side that the reader turns."""
    frames = int(table["frame"].max()) + 1
    bottom = min(float(table["z"].min()), 0.0)
    tall = float(table["z"].max()) - bottom
    reach = 1.06 * max(float(np.hypot(table["x"], table["y"]).max()), 0.5 * tall, 1e-3)
    low = bottom - 0.5 * (2 * reach - tall)
    frame: dict[str, Any] = {"nice": False, "zero": False}
    x = alt.X("across:Q", title="across [m]", scale=alt.Scale(domain=[-reach, reach], **frame))
    y = alt.Y("z:Q", title="height [m]", scale=alt.Scale(domain=[low, low + 2 * reach], **frame))
    across = "datum.x * cos(turn * PI / 180) + datum.y * sin(turn * PI / 180)"
    base = named("postures").transform_calculate(across=across).encode(x=x, y=y)
    posture = base.transform_filter("datum.frame == frame")
    end = base.transform_filter(f"datum.place == {int(table['place'].max())}")
    told = tips("name:N|joint; t:Q|time [s]|.2f; x:Q||.3f; y:Q||.3f; z:Q||.3f")
    layers = [
        end.mark_line(opacity=0.45, strokeWidth=1.2, color="var(--c5)").encode(order="frame:Q"),
        posture.mark_line(strokeWidth=7, strokeCap="round", color="var(--c0)", opacity=0.85).encode(
            order="place:Q"
        ),
        posture.mark_circle(size=90, color="var(--ink)", opacity=1).encode(tooltip=told),
    ]
    asked = [alt.param(name=name, value=0) for name in ("turn", "frame")]
    times = [(k, f"{100 * k / max(frames - 1, 1):.0f} % of the cycle") for k in range(frames)]
    return Chart(
        "motion",
        "The robot through a test-cycle",
        alt.layer(*layers).add_params(*asked).properties(width=360, height=360),
        {"postures": Source("postures", {"robot": "robot", "cycle": "cycle"})},
        "Joints and the lines between them by forward kinematics; thin: the path of the end.",
        [
            Choice("frame", "Time", times, slides=True, plays=True),
            Choice("turn", "Seen from", [(k, f"{k}°") for k in range(0, 360, 15)], default=90, slides=True),
        ],
        ["robot", "cycle"],
    )
