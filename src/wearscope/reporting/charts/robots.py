"""Charts of what was simulated: the robots' friction and their motion through the test-cycles."""

import altair as alt
import numpy as np

from wearscope.reporting.charts.base import Chart, Choice, Source
from wearscope.reporting.charts.encoding import add_zoom, named, tips
from wearscope.reporting.study import Study


def chart_friction(study: Study) -> Chart:
    """Friction of a joint over speed at several temperatures and wear levels."""
    table = study.friction
    assert table is not None
    unit = sorted(table["torque_unit"].unique())[0]
    spec, fields = add_zoom(
        named("friction")
        .mark_line()
        .encode(
            x=alt.X(
                "speed:Q",
                title=f"joint speed [{table['speed_unit'].iloc[0]}]",
                scale=alt.Scale(type="log", nice=False),
                axis=alt.Axis(tickCount=5, format="~g"),
            ),
            y=alt.Y("torque:Q", title=f"friction torque [{unit}]", scale=alt.Scale(zero=False)),
            color=alt.Color(
                "temperature:O",
                title="temperature [°C]",
                scale=alt.Scale(range=["var(--c0)", "var(--c5)", "var(--c1)"]),
            ),
            strokeDash=alt.StrokeDash("wear:O", title="wear"),
            tooltip=tips("speed:Q||.3; torque:Q||.4; temperature:O|temperature [°C]; wear:O"),
        ),
        "speed",
        "torque",
    )
    joints = list(dict.fromkeys(table["joint"]))
    return Chart(
        "friction",
        "Friction over speed",
        spec.properties(width="container", height=320),
        {"friction": Source("friction", {"robot": "robot", "joint": "joint"})},
        "As the robot's model has it.",
        [Choice("joint", "Joint", [(name, name.replace("_", " ")) for name in joints])],
        ["robot"],
        zoom=fields,
    )


def chart_motion(study: Study) -> Chart:
    """A robot moving through a test-cycle, seen from a side that the reader turns."""
    table = study.postures
    assert table is not None
    frames = int(table["frame"].max()) + 1
    bottom = min(float(table["z"].min()), 0.0)
    tall = float(table["z"].max()) - bottom
    reach = 1.06 * max(float(np.hypot(table["x"], table["y"]).max()), 0.5 * tall, 1e-3)
    low = bottom - 0.5 * (2 * reach - tall)
    high = low + 2 * reach
    turn = alt.param(name="turn", value=0)
    now = alt.param(name="frame", value=0)
    across = "datum.x * cos(turn * PI / 180) + datum.y * sin(turn * PI / 180)"
    x = alt.X("across:Q", title="across [m]", scale=alt.Scale(domain=[-reach, reach], nice=False, zero=False))
    y = alt.Y("z:Q", title="height [m]", scale=alt.Scale(domain=[low, high], nice=False, zero=False))
    base = named("postures").transform_calculate(across=across)
    posture = base.transform_filter("datum.frame == frame")
    path = (
        base.transform_filter(f"datum.place == {int(table['place'].max())}")
        .mark_line(opacity=0.45, strokeWidth=1.2, color="var(--c5)")
        .encode(x=x, y=y, order="frame:Q")
    )
    links = posture.mark_line(strokeWidth=7, strokeCap="round", color="var(--c0)", opacity=0.85).encode(
        x=x, y=y, order="place:Q"
    )
    joints = posture.mark_circle(size=90, color="var(--ink)", opacity=1).encode(
        x=x,
        y=y,
        tooltip=tips("name:N|joint; t:Q|time [s]|.2f; x:Q||.3f; y:Q||.3f; z:Q||.3f"),
    )
    spec = alt.layer(path, links, joints).add_params(turn, now).properties(width=360, height=360)
    return Chart(
        "motion",
        "The robot through a test-cycle",
        spec,
        {"postures": Source("postures", {"robot": "robot", "cycle": "cycle"})},
        "Joints and the lines between them by forward kinematics; thin: the path of the end.",
        [
            Choice(
                "frame",
                "Time",
                [(k, f"{100 * k / max(frames - 1, 1):.0f} % of the cycle") for k in range(frames)],
                slides=True,
                plays=True,
            ),
            Choice("turn", "Seen from", [(k, f"{k}°") for k in range(0, 360, 15)], default=90, slides=True),
        ],
        ["robot", "cycle"],
    )
