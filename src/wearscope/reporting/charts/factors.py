"""Charts of Q-1: how much each factor weighs relative to wear, and the test quantity over each factor."""

import altair as alt

from wearscope.reporting.charts.base import BY_CELL, Chart, Choice, Source
from wearscope.reporting.charts.encoding import add_zoom, cell_tips, colour, named, tips
from wearscope.reporting.labels import factor_name
from wearscope.reporting.study import Study

KINDS = (("direct", "direct effects"), ("interaction", "interactions"), ("square", "squares"))
SYMLOG = alt.Scale(type="symlog", constant=1)


def symlog_axis(steps: tuple[int, ...]) -> alt.Axis:
    """Axis of such a scale: 0 and, on both sides, these multiples of powers of ten."""
    sizes = [step * 10**power for power in range(7) for step in steps]
    return alt.Axis(values=[*(-size for size in reversed(sizes)), 0, *sizes], labelOverlap="greedy")


def chart_weights(study: Study) -> Chart:
    """Every cell's coefficients over that of wear, by factor and detector."""
    names = study.detector_names()
    base = named("weights").encode(
        y=alt.Y("term:N", title=None, sort=None, axis=alt.Axis(labelLimit=200)),
        yOffset=alt.YOffset("fda:N", scale=alt.Scale(domain=list(names))),
        color=alt.Color("fda:N", **colour(names)),
    )
    band = alt.Chart(alt.InlineData([{"low": -1, "high": 1}])).mark_rect(color="var(--line)", opacity=0.45)
    points = base.mark_circle(opacity=0.65).encode(
        x=alt.X(
            "weight:Q",
            title="coefficient (wear: 1)",
            scale=SYMLOG,
            axis=symlog_axis((1, 2, 5)),
        ),
        tooltip=[*cell_tips(), *tips("term:N; weight:Q||.3")],
    )
    median = base.mark_tick(thickness=2.5, size=13).encode(
        x=alt.X("median(weight):Q", title="coefficient (wear: 1)"),
        color=alt.value("var(--ink)"),
        detail="fda:N",
        tooltip=tips("median(weight):Q|median|.3; fda:N|detector"),
    )
    spec = alt.layer(band.encode(x="low:Q", x2="high:Q"), points, median)
    return Chart(
        "weights",
        "How much each factor weighs relative to wear",
        spec.properties(width="container", height={"step": 13 if len(names) > 2 else 18}),
        {"weights": Source("weights", {"kind": "kind", **BY_CELL})},
        "A point is a cell: what a step of the factor does to y, over what the same step of wear does. "
        "Dark ticks: medians of what is shown. Beyond the grey band a factor weighs more than wear; the "
        "scale turns logarithmic there.",
        [Choice("kind", "Show", KINDS)],
    )


def chart_response(study: Study, detector: str = "") -> Chart:
    """Test quantity of a cell over a factor: surrogate, interval, simulated runs."""
    x = alt.X("natural:Q", title="⟦factor⟧", scale=alt.Scale(zero=False))
    lines = named("responses")
    band = lines.mark_area(opacity=0.2, color="var(--c0)").encode(
        x=x, y=alt.Y("low:Q", title="⟦fda.y⟧", scale=alt.Scale(zero=False)), y2="high:Q"
    )
    line = lines.mark_line(color="var(--c0)").encode(
        x=x,
        y="y:Q",
        tooltip=tips("natural:Q|⟦factor⟧|.4; y:Q|surrogate|.4; low:Q||.4; high:Q||.4"),
    )
    held = alt.param(name="held", value="y_held")
    points = (
        named("simulated")
        .transform_calculate(shown="held == 'y' ? datum.y : datum.y_held")
        .mark_circle(opacity=0.7)
        .encode(
            x=x,
            y=alt.Y("shown:Q"),
            color=alt.Color(
                "set:N",
                title="simulated for",
                scale=alt.Scale(range=["var(--c1)", "var(--c2)", "var(--c5)", "var(--c3)"]),
            ),
            tooltip=tips(
                "set:N|run of; natural:Q|⟦factor⟧|.4; y:Q|y as simulated|.4; y_held:Q|y, others at nominal|.4"
            ),
        )
    )
    layered, fields = add_zoom(alt.layer(band, line, points).add_params(held), "natural", "low")
    by = {"factor": "factor", **BY_CELL}
    return Chart(
        "response",
        "The test quantity over each factor",
        layered.properties(width="container", height=330),
        {"responses": Source("responses", by), "simulated": Source("simulated", by)},
        "Line and band: the surrogate that the questions are asked of, with the other factors at nominal, "
        "and where 95 % of new runs should lie. Points: simulated runs, of which the surrogate takes away "
        "what their other factors did, or as they were simulated.",
        [
            Choice("factor", "Over", [(one.name, factor_name(one)) for one in study.factors]),
            Choice("held", "Points", [("y_held", "other factors at nominal"), ("y", "as simulated")]),
        ],
        ["robot", "cycle", "axis", "fda"],
        {"fda": detector} if detector else {},
        fields,
    )
