"""Charts of a tracked machine: friction and every parameter over the sessions, with intervals."""

import altair as alt
import pandas as pd

from wearscope.reporting.charts.base import Chart, Choice, Source
from wearscope.reporting.charts.encoding import named, tips
from wearscope.reporting.labels import with_unit, words
from wearscope.reporting.tracking import Tracking

_STATES = {
    "healthy, held out": ("var(--soft)", "square"),
    "no change named": ("var(--after)", "circle"),
    "change named": ("var(--before)", "diamond"),
}
_SHARE = "friction"


def trend_table(tracking: Tracking) -> pd.DataFrame:
    """Friction in per cent of the healthy one's, and every other parameter that changed, by session.

    Columns: `joint`, `session`, `what` (a key of `trend_names`), `value`, `low`, `high`, `state`.
    """
    named_in = {(session, one["joint"], one["effect"]) for session, one in tracking.entries()}
    at_joint = {(session, joint) for session, joint, _ in named_in}
    parts = []
    for what, (joint, effect, parameter) in _list_parameters(tracking):
        rows = tracking.rows(joint, effect, parameter)
        share = 100.0 / float((rows["value"] - rows["change"]).median()) if what == _SHARE else 1.0
        ends = {end: share * rows[f"value_{end}"].astype(float) for end in ("low", "high")}
        table = pd.DataFrame({"value": share * rows["value"].astype(float), **ends}).reset_index()
        known = at_joint if what == _SHARE else {(s, j) for s, j, e in named_in if e == effect}
        changed = ["change named" if (one, joint) in known else "no change named" for one in table["session"]]
        healthy = rows["healthy"].eq(True).to_numpy()
        table["state"] = pd.Series(changed).mask(healthy, "healthy, held out")
        parts.append(table.assign(joint=joint, what=what))
    return pd.concat(parts, ignore_index=True)


def trend_names(tracking: Tracking) -> dict[str, str]:
    """What can be drawn over the sessions, with its unit."""
    units = {
        what: str(tracking.rows(*key)["unit"].dropna().iloc[0]) for what, key in _list_parameters(tracking)
    }
    return {
        what: "friction [% of healthy]" if what == _SHARE else with_unit(words(what), unit)
        for what, unit in units.items()
    }


def _list_parameters(tracking: Tracking) -> list[tuple[str, tuple[str, str, str]]]:
    found = [(_SHARE, (joint, "friction", "torque")) for joint in tracking.joints]
    changed = {(one["joint"], one["effect"], one["parameter"]): None for _, one in tracking.entries()}
    return found + [(f"{effect} of {joint}, {parameter}", (joint, effect, parameter))
                    for joint, effect, parameter in changed if effect != "friction"]  # fmt: skip


def chart_trend(tracking: Tracking) -> Chart:
    """Values over the sessions; an interval that says nothing may leave the frame."""
    x = alt.X("session:N", title=None, sort=None, axis=alt.Axis(labelAngle=-50, labelOverlap=True))
    frame = "max(1.5 * (datum.top - datum.bottom), 0.2 * max(abs(datum.top), abs(datum.bottom)))"
    tints, shapes = zip(*_STATES.values(), strict=True)
    base = (
        named("trend")
        .transform_joinaggregate(top="max(value)", bottom="min(value)")
        .transform_calculate(reach=frame, middle="(datum.top + datum.bottom) / 2")
        .transform_calculate(
            start="max(datum.low, datum.middle - datum.reach)",
            end="min(datum.high, datum.middle + datum.reach)",
        )
        .encode(
            x=x,
            xOffset=alt.XOffset("joint:N"),
            color=alt.Color("state:N", title=None, scale=alt.Scale(domain=list(_STATES), range=list(tints))),
            tooltip=tips("joint:N; session:N; value:Q|⟦what⟧|.4; low:Q|95 % from|.4; high:Q|to|.4; state:N"),
        )
    )
    shape = alt.Shape("state:N", title=None, scale=alt.Scale(domain=list(_STATES), range=list(shapes)))
    spans = base.mark_rule(strokeWidth=1.5).encode(
        y=alt.Y("start:Q", title="⟦what⟧", scale=alt.Scale(zero=False)), y2="end:Q"
    )
    points = base.mark_point(size=55, opacity=1).encode(y="value:Q", shape=shape)
    return Chart(
        "trend-chart",
        "Over the sessions",
        alt.layer(spans, points).properties(width="container", height=320),
        {"trend": Source("trend", {"what": "what", "joint": "joint"})},
        "Friction: RMS torque against that of the healthy machine, along each session's own motion. The 95 % "
        "intervals hold the session's noise, the error of the reference and the scatter of healthy sessions. "
        "Each healthy session is compared with the other ones. Joints side by side; filter to see one.",
        [Choice("what", "Show", [(what, name) for what, name in trend_names(tracking).items()])],
    )
