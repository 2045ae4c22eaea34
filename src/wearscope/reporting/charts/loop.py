"""Charts of a closed loop: errors, torque and residual over time and over signals, candidates, angles."""

import json

import altair as alt

from wearscope.reporting.charts.base import Chart, Choice, Source
from wearscope.reporting.charts.encoding import add_zoom, named, tips
from wearscope.reporting.charts.loop_data import error_table, series_table, signal_choices
from wearscope.reporting.closed_loop import ClosedLoop

_LINES = {"measured": "var(--ink)", "before": "var(--before)", "after": "var(--after)"}
STAGE_SCALE = alt.Scale(domain=["before", "after"], range=["var(--before)", "var(--after)"])
_KINDS = {
    "before": "var(--before)",
    "after": "var(--after)",
    "noise floor": "var(--ink)",
    "as declared": "var(--soft)",
}


def chart_errors(loop: ClosedLoop) -> Chart:
    """RMS error of every joint: before, after, noise floor and what else is known."""
    known = set(error_table(loop)["kind"])
    kinds = [kind for kind in _KINDS if kind in known]
    tints = [_KINDS[kind] for kind in kinds]
    base = named("errors").encode(
        y=alt.Y("joint:N", title=None, sort=loop.joints),
        yOffset=alt.YOffset("kind:N", scale=alt.Scale(domain=kinds)),
        color=alt.Color("kind:N", title=None, scale=alt.Scale(domain=kinds, range=tints)),
        tooltip=tips("joint:N; kind:N; value:Q|RMS error|.4; low:Q|95 % from|.4; high:Q|to|.4; unit:N"),
    )
    units = sorted({one["unit"] for one in loop.verdict["joints"].values()})
    x = alt.X(
        "value:Q", title=f"RMS error on the test runs [{' or '.join(units)}]", scale=alt.Scale(type="log")
    )
    spans = base.transform_filter("isValid(datum.low)").mark_rule(strokeWidth=4, opacity=0.4)
    points = base.transform_filter("datum.kind != 'noise floor'").mark_circle(size=65, opacity=1)
    floors = base.transform_filter("datum.kind == 'noise floor'").mark_tick(thickness=3, size=13)
    layers = [spans.encode(x=alt.X("low:Q"), x2="high:Q"), points.encode(x=x), floors.encode(x=x)]
    return Chart(
        "errors-chart",
        "Error of every joint before and after",
        alt.layer(*layers).properties(width="container", height={"step": 9}),
        {"errors": Source("errors", {"joint": "joint"})},
        "At the common bandwidth, with 95 % intervals from resampled blocks. Before: the declared model, its "
        "own parameters refitted on the training runs; as declared: without that.",
    )


def chart_torque(loop: ClosedLoop, joint: str, run: str) -> Chart | None:
    """Measured and predicted torque over time; None where only residuals were kept."""
    if "predicted_after" not in series_table(loop):
        return None
    return _chart_over_time(
        ("series", {"measured": "measured", "predicted_before": "before", "predicted_after": "after"}),
        "torque",
        {"joint": joint, "run": run},
        "torque",
        "Measured and predicted torque",
        "At the common bandwidth, thinned for the page; residual.parquet has every row. Zoom with Ctrl and "
        "the wheel or the buttons, drag to move.",
    )


def chart_residual(loop: ClosedLoop, joint: str, run: str) -> Chart:
    """Residual over time, before and after."""
    return _chart_over_time(
        ("series", {"residual_before": "before", "residual_after": "after"}),
        "residual",
        {"joint": joint, "run": run},
        "residual-chart",
        "Residual over time",
        "Measured less predicted, where rows count.",
    )


def chart_forward(loop: ClosedLoop, joint: str) -> Chart | None:
    """Torque error of both models simulated forward; None where they were not."""
    if loop.forward_series is None or not len(loop.forward_series):
        return None
    return _chart_over_time(
        ("forward", {"before": "before", "after": "after"}),
        "error",
        {"joint": joint},
        "forward-chart",
        "Simulated forward less measured",
        "In PyBullet, at the common bandwidth, on the test runs.",
    )


def _chart_over_time(
    source: tuple[str, dict[str, str]],
    quantity: str,
    first: dict[str, str],
    name: str,
    title: str,
    caption: str,
) -> Chart:
    """Columns of a source, by what they are called, of one joint and run over time."""
    table, columns = source
    shown = [*columns.values()]
    scale = alt.Scale(domain=shown, range=[_LINES[one] for one in shown])
    lines = (
        named(table)
        .transform_fold([*columns], as_=["key", "torque"])
        .transform_calculate(line=f"({json.dumps(columns)})[datum.key]")
        .mark_line(strokeWidth=1.3, clip=True)
        .encode(
            x=alt.X("t:Q", title="time [s]", scale=alt.Scale(zero=False, nice=False)),
            y=alt.Y("torque:Q", title=f"{quantity} [⟦joint.unit⟧]"),
            color=alt.Color("line:N", title=None, scale=scale, sort=shown),
            tooltip=tips("t:Q|time [s]|.3f; line:N|which; torque:Q|[⟦joint.unit⟧]|.4"),
        )
    )
    spec, fields = add_zoom(lines, "t", "torque")
    return Chart(
        name,
        title,
        spec.properties(width="container", height=280),
        {table: Source(table, {"joint": "joint", "run": "run"})},
        caption,
        single=["joint", "run"],
        first=first,
        zoom=fields,
    )


def chart_against(loop: ClosedLoop, joint: str) -> Chart:
    """Residual over a signal: points, and medians with quartiles in bins."""
    x = alt.X("x:Q", title="⟦joint+choice⟧", scale=alt.Scale(zero=False))
    tint = alt.Color("stage:N", title=None, scale=STAGE_SCALE, sort=["before", "after"])
    points = (
        named("against")
        .transform_fold(["residual_before", "residual_after"], as_=["key", "residual"])
        .transform_calculate(stage="replace(datum.key, 'residual_', '')")
        .mark_circle(size=12, opacity=0.28, clip=True)
        .encode(
            x=x,
            y=alt.Y("residual:Q", title="residual [⟦joint.unit⟧]"),
            color=tint,
            tooltip=tips("x:Q|⟦joint+choice⟧|.4; residual:Q|residual [⟦joint.unit⟧]|.4; stage:N; run:N"),
        )
    )
    layers: list[alt.Chart] = [points]
    by = {"joint": "joint", "choice": "choice"}
    sources = {"against": Source("against", by | {"run": "run"})}
    text = "Points: rows that count, thinned for the page."
    if loop.profiles is not None:
        lines = named("profiles").encode(x=x, color=tint)
        layers += [
            lines.mark_area(opacity=0.25, clip=True).encode(y=alt.Y("low:Q"), y2="high:Q"),
            lines.mark_line(strokeWidth=2.5, clip=True, point=True).encode(
                y="median:Q",
                tooltip=tips(
                    "x:Q|⟦joint+choice⟧|.4; median:Q||.4; low:Q|quartile|.4; high:Q|quartile|.4; "
                    "stage:N; n:Q|rows"
                ),
            ),
        ]
        sources["profiles"] = Source("profiles", by)
        text += " Lines and bands: medians and quartiles in bins, over all runs."
    spec, fields = add_zoom(alt.layer(*layers), "x", "residual")
    return Chart(
        "against",
        "Residual over the signal that it depends on",
        spec.properties(width="container", height=320),
        sources,
        text + " What a residual depends on: the signals that the verdict names first, then those that a "
        "spline finds. Over its own speed the residual shows the friction that the model lacks.",
        [Choice("choice", "Over", signal_choices(loop))],
        ["joint"],
        {"joint": joint},
        fields,
    )


def chart_candidates(loop: ClosedLoop) -> Chart | None:
    """What each candidate gains, step by step; None where there was none."""
    if not len(loop.candidates):
        return None
    steps = sorted(int(step) for step in loop.candidates["step"].unique())
    spec = (
        named("candidates")
        .mark_bar(cornerRadius=2)
        .encode(
            y=alt.Y("label:N", title=None, sort=None, axis=alt.Axis(labelLimit=240)),
            x=alt.X("gain:Q", title="held-out loss removed [%]"),
            color=alt.Color(
                "taken:N",
                title=None,
                scale=alt.Scale(domain=["taken", "left"], range=["var(--after)", "var(--soft)"]),
            ),
            opacity=alt.condition("datum.taken === 'taken'", alt.value(1), alt.value(0.45)),
            tooltip=tips("label:N|candidate; gain:Q|gain [%]|.3; p_value:Q|p|.2; reason:N"),
        )
    )
    return Chart(
        "candidates-chart",
        "Candidates at each step",
        spec.properties(width="container", height={"step": 20}),
        {"candidates": Source("candidates", {"step": "step", "joint": "joint"})},
        "Loss: in % of the joint's. The pointer tells why a candidate was not taken.",
        [Choice("step", "Step", [(step, str(step + 1)) for step in steps], default=steps[0])],
    )
