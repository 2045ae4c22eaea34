"""Charts of a closed loop: errors, torque and residual over time and over signals."""

import json

import altair as alt
import numpy as np
import pandas as pd

from wearscope.reporting.charts.base import Chart, Choice, Source
from wearscope.reporting.charts.encoding import add_zoom, named, offset, tint, tips
from wearscope.reporting.closed_loop import (
    STAGES,
    ClosedLoop,
    against_signal,
    dominant_signals,
    label_signal,
    number,
)

#: Largest number of rows of all joints and runs in the charts over time, and of points over a signal.
MOST_ROWS, MOST_POINTS = 40_000, 600
#: Signals that a residual can be drawn over, in addition to the signal that it depends on most.
OWN = {
    "qd": "its own speed",
    "q": "its own position",
    "qdd": "its own acceleration",
    "load": "its own rigid-body torque",
    "temp": "its temperature",
    "t": "time in the run",
}
RANKS = ("what it depends on most", "the second such signal", "the third such signal")
_TINTS = {"before": "var(--before)", "after": "var(--after)"}
_KINDS = _TINTS | {"noise floor": "var(--ink)", "as declared": "var(--soft)"}


def loop_filters(loop: ClosedLoop) -> list[Choice]:
    """Filters of all charts: joint and run."""
    uses = dict(zip(loop.residual["run"], loop.residual["use"], strict=True))
    return [
        Choice("joint", "Joint", [(name, name) for name in loop.joints]),
        Choice("run", "Run", [(name, f"{_short_run(name)} ({use})") for name, use in uses.items()]),
    ]


def _short_run(name: str) -> str:
    """A run's file without its folder and ending."""
    return name.rsplit("/", 1)[-1].rsplit(".", 1)[0]


def _choices(loop: ClosedLoop) -> dict[tuple[str, str], str]:
    """Signal by joint and choice: what the joint's residual depends on most, then its own signals."""
    found: dict[tuple[str, str], str] = {}
    for joint in loop.joints:
        found |= {(joint, str(k)): signal for k, signal in enumerate(dominant_signals(loop, joint))}
        found |= {(joint, code): "t" if code == "t" else f"{code}_{joint}" for code in OWN}
    return found


def loop_labels(loop: ClosedLoop) -> dict[str, dict[str, str]]:
    """Labels of every choice's values, and of the tables' columns."""
    return {
        "joint.unit": {joint: loop.verdict["joints"][joint]["unit"] for joint in loop.joints},
        "run": {name: _short_run(name) for name in loop.residual["run"].unique()},
        "joint+choice": {"|".join(key): label_signal(loop, one) for key, one in _choices(loop).items()},
        "column": {"t": "time [s]", "x": "signal"},
    }


def loop_tables(loop: ClosedLoop) -> dict[str, pd.DataFrame]:
    """Tables that the charts draw, by name; only those that the loop has."""
    found = {"errors": _list_errors(loop), "series": _thin_series(loop), "against": _list_points(loop)}
    if loop.profiles is not None:
        asked = pd.DataFrame([(*key, signal) for key, signal in _choices(loop).items()])
        asked = asked.set_axis(["joint", "choice", "signal"], axis=1)
        found["profiles"] = asked.merge(loop.profiles, on=["joint", "signal"]).drop(columns="signal")
    return found


def _list_errors(loop: ClosedLoop) -> pd.DataFrame:
    """RMS errors on the test runs: ``joint``, ``unit``, ``kind``, ``value``, ``low``, ``high``."""
    fields = {
        **{stage: f"rms_{stage}" for stage in STAGES},
        "as declared": "rms_as_declared",
        "noise floor": "noise_floor",
    }
    records = []
    for joint, one in loop.verdict["joints"].items():
        for kind, field in fields.items():
            ends = one.get(f"{field}_ci95") or (None, None)
            numbers = [number(value) for value in (one.get(field), *ends)]
            records.append((joint, one["unit"], kind, *numbers))
    table = pd.DataFrame(records, columns=["joint", "unit", "kind", "value", "low", "high"])
    return table[np.isfinite(table["value"])].reset_index(drop=True)


def _thin_runs(table: pd.DataFrame) -> pd.DataFrame:
    """Evenly spaced rows of each joint and run, about `MOST_ROWS` in all at most."""
    runs = table.groupby(["joint", "run"], sort=False)["t"]
    each = max(50, MOST_ROWS // max(1, runs.ngroups))
    return table[(runs.cumcount() % np.maximum(1, -(-runs.transform("size") // each))) == 0]


def _thin_series(loop: ClosedLoop) -> pd.DataFrame:
    """Torque and residual over time; NaN where a residual does not count."""
    wanted = ["measured", "predicted_before", "predicted_after", "residual_before", "residual_after"]
    table = _thin_runs(loop.residual)
    shown = table[["joint", "run", "t", *(name for name in wanted if name in table)]].copy()
    left = [name for name in shown if name.startswith("residual")]
    shown[left] = shown[left].where(table["counts"].astype(bool))
    return shown


def _list_points(loop: ClosedLoop) -> pd.DataFrame:
    """Residuals over each signal to choose: ``run``, ``x``, both residuals, ``joint``, ``choice``."""
    parts = []
    for (joint, choice), signal in _choices(loop).items():
        if signal == "t" or loop.signals is not None:
            own = against_signal(loop, joint, signal)
            own = own.iloc[:: max(1, -(-len(own) // MOST_POINTS))]
            own = own[["run", "x", "residual_before", "residual_after"]]
            parts.append(own.assign(joint=joint, choice=choice))
    return pd.concat(parts, ignore_index=True)


def chart_errors(loop: ClosedLoop, table: pd.DataFrame) -> Chart:
    """RMS error of every joint: before, after, noise floor, and other errors where they are known."""
    kinds = {kind: colour for kind, colour in _KINDS.items() if kind in set(table["kind"])}
    base = named("errors").encode(
        y=alt.Y("joint:N", title=None, sort=loop.joints),
        yOffset=offset("kind:N", kinds),
        color=tint("kind:N", kinds),
        tooltip=tips("joint:N; kind:N; value:Q|RMS error|.4; low:Q|95 % from|.4; high:Q|to|.4; unit:N"),
    )
    units = " or ".join(sorted({one["unit"] for one in loop.verdict["joints"].values()}))
    x = alt.X("value:Q", title=f"RMS error on the test runs [{units}]", scale=alt.Scale(type="log"))
    spans = base.transform_filter("isValid(datum.low)").mark_rule(strokeWidth=4, opacity=0.4)
    points = base.transform_filter("datum.kind != 'noise floor'").mark_circle(size=65, opacity=1)
    floors = base.transform_filter("datum.kind == 'noise floor'").mark_tick(thickness=3, size=13)
    layers = [spans.encode(x="low:Q", x2="high:Q"), points.encode(x=x), floors.encode(x=x)]
    return Chart(
        "errors-chart",
        "Error of every joint before and after",
        alt.layer(*layers).properties(width="container", height={"step": 9}),
        {"errors": Source("errors", {"joint": "joint"})},
        "At the common bandwidth, with 95 % intervals from resampled blocks. Before: the declared model, its "
        "own parameters refitted on the training runs; as declared: without that.",
    )


def charts_over_time(loop: ClosedLoop, joint: str, run: str) -> list[Chart]:
    """Measured and predicted torque, where predictions were kept, and the residual."""
    first = {"joint": joint, "run": run}
    torque = _over_time(
        {"measured": "measured", "predicted_before": "before", "predicted_after": "after"},
        "torque",
        first,
        "torque",
        "Measured and predicted torque",
        "At the common bandwidth, thinned for the page; residual.parquet has every row. Zoom with Ctrl and "
        "the wheel or the buttons, drag to move.",
    )
    residual = _over_time(
        {"residual_before": "before", "residual_after": "after"},
        "residual",
        first,
        "residual-chart",
        "Residual over time",
        "Measured minus predicted torque, in the rows that count.",
    )
    return [torque, residual] if "predicted_after" in loop.residual else [residual]


def _over_time(
    columns: dict[str, str], quantity: str, first: dict[str, str], name: str, title: str, caption: str
) -> Chart:
    """Columns of the table ``series`` over time for one joint and run; `columns` has the legend's names."""
    tints = {one: _TINTS.get(one, "var(--ink)") for one in columns.values()}
    lines = (
        named("series")
        .transform_fold([*columns], as_=["key", "torque"])
        .transform_calculate(line=f"({json.dumps(columns)})[datum.key]")
        .mark_line(strokeWidth=1.3, clip=True)
        .encode(
            x=alt.X("t:Q", title="time [s]", scale=alt.Scale(zero=False, nice=False)),
            y=alt.Y("torque:Q", title=f"{quantity} [⟦joint.unit⟧]"),
            color=tint("line:N", tints, sort=[*tints]),
            tooltip=tips("t:Q|time [s]|.3f; line:N|which; torque:Q|[⟦joint.unit⟧]|.4"),
        )
    )
    spec, fields = add_zoom(lines.properties(width="container", height=280), "t", "torque")
    sources = {"series": Source("series", {"joint": "joint", "run": "run"})}
    return Chart(name, title, spec, sources, caption, single=["joint", "run"], first=first, zoom=fields)


def chart_against(loop: ClosedLoop, joint: str) -> Chart:
    """Residual over a signal: points, and medians with quartiles in bins."""
    x = alt.X("x:Q", title="⟦joint+choice⟧", scale=alt.Scale(zero=False))
    stage = tint("stage:N", _TINTS, sort=[*_TINTS])
    points = (
        named("against")
        .transform_fold(["residual_before", "residual_after"], as_=["key", "residual"])
        .transform_calculate(stage="replace(datum.key, 'residual_', '')")
        .mark_circle(size=12, opacity=0.28, clip=True)
        .encode(
            x=x,
            y=alt.Y("residual:Q", title="residual [⟦joint.unit⟧]"),
            color=stage,
            tooltip=tips("x:Q|⟦joint+choice⟧|.4; residual:Q|residual [⟦joint.unit⟧]|.4; stage:N; run:N"),
        )
    )
    layers: list[alt.Chart] = [points]
    by = {"joint": "joint", "choice": "choice"}
    sources = {"against": Source("against", by | {"run": "run"})}
    text = "Points: rows that count, thinned for the page."
    if loop.profiles is not None:
        lines = named("profiles").encode(x=x, color=stage)
        told = "x:Q|⟦joint+choice⟧|.4; median:Q||.4; low:Q|quartile|.4; high:Q|quartile|.4; stage:N; n:Q|rows"
        layers += [
            lines.mark_area(opacity=0.25, clip=True).encode(y="low:Q", y2="high:Q"),
            lines.mark_line(strokeWidth=2.5, clip=True, point=True).encode(y="median:Q", tooltip=tips(told)),
        ]
        sources["profiles"] = Source("profiles", by)
        text += " Lines and bands: medians and quartiles in bins, over all runs."
    spec, fields = add_zoom(alt.layer(*layers).properties(width="container", height=320), "x", "residual")
    ranks = [(str(k), told) for k, told in enumerate(RANKS)]
    over = [("t", OWN["t"])] if loop.signals is None else [*ranks, *OWN.items()]
    return Chart(
        "against",
        "Residual over the signal that it depends on",
        spec,
        sources,
        text + " What a residual depends on: the signals that the verdict names first, then those that a "
        "spline finds. Over its own speed the residual shows the friction that the model lacks.",
        [Choice("choice", "Over", over)],
        ["joint"],
        {"joint": joint},
        fields,
    )
