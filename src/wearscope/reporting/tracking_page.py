"""The page of a tracked machine: what changed since it was healthy, and the trend of each joint."""

from collections.abc import Container, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import altair as alt
import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.effects.vocabulary import list_effects
from wearscope.reporting.charts.base import Chart, Choice, Source
from wearscope.reporting.charts.encoding import named, tint, tips
from wearscope.reporting.closed_loop import join_events, render_event_table
from wearscope.reporting.labels import (
    change_name,
    count_text,
    effect_name,
    join_some,
    join_words,
    parameter_name,
    unit_text,
    upper_first,
    with_unit,
)
from wearscope.reporting.page import (
    JOINT,
    Section,
    embed_chart,
    format_number,
    interval_text,
    render_page,
    render_part,
    render_table,
    say,
)
from wearscope.reporting.page_strip import Strip
from wearscope.storage import tables
from wearscope.storage.files import read_json

_WORDS = "tracking/strip.html"
_OPEN = "changed, cause not told"
_STATES = {
    "healthy, held out": "square",
    "no change named": "circle",
    "change named": "diamond",
    _OPEN: "triangle-up",
}
_TINTS = ("var(--soft)", "var(--after)", "var(--before)", "var(--c5)")
_SHARE = "friction"
#: Effects that count as wear, for maintenance.
_WEARS = {effect.name for effect in list_effects() if effect.is_friction and not effect.is_thermal}
_MOST_TOLD = 3
#: Largest number of panels of changed quantities.
_MOST_PANELS = 6
#: Fields of `smallest_visible`, each with its unit and scale on the page.
_SEEN = (("friction", "[%]", 100.0), ("mass", "[kg]", 1.0))


#: Beginning of a sentence on friction that changed by wear or by temperature.
_OPEN_FRICTION = "The friction of "


@dataclass(frozen=True)
class Tracking:
    """Outcome of tracking one machine: ``tracking.json`` and ``changes.parquet``."""

    outcome: Mapping[str, Any]
    changes: pd.DataFrame

    @property
    def joints(self) -> list[str]:
        """Joint names, in the data set's order."""
        return list(self.outcome["healthy"]["temperatures"])

    def entries(self) -> list[tuple[str, Mapping[str, Any]]]:
        """Session and entry of every change."""
        return [(one["session"], entry) for one in self.outcome["sessions"] for entry in one["changes"]]

    def changed_before(self) -> list[str]:
        """Earlier sessions with a change, or with changed friction at joints where the last has none."""
        return [
            one["session"]
            for k, one in enumerate(self.outcome["sessions"][:-1])
            if one["changes"] or self.open_changes(k).keys() - self.open_changes().keys()
        ]

    def open_changes(self, place: int = -1) -> dict[str, str]:
        """Sentence for each joint whose friction changed in a session, by wear or by temperature."""
        return {
            joint: text
            for joint in self.joints
            for text in self.outcome["sessions"][place]["cannot_tell"]
            if text.startswith(f"{_OPEN_FRICTION}{joint} changed by ")
        }

    def open_since(self, joint: str) -> str:
        """Session from which on every session, up to the last, has such a change at a joint."""
        sessions = self.outcome["sessions"]
        place = len(sessions) - 1
        while place > 0 and joint in self.open_changes(place - 1):
            place -= 1
        return str(sessions[place]["session"])

    def parameters(self) -> dict[str, pd.DataFrame]:
        """Tables of each joint's friction and of every other parameter that changed, by name.

        A table has one row per session in order; the healthy sessions, held out, come first.
        """
        table = self.changes
        sessions = [*dict.fromkeys(table.loc[table["healthy"], "session"])]
        sessions += [one["session"] for one in self.outcome["sessions"]]
        asked = [(joint, _SHARE, "torque") for joint in self.joints]
        changed = [(one["joint"], one["effect"], one["parameter"]) for _, one in self.entries()]
        found = {}
        for joint, effect, parameter in dict.fromkeys(asked + [one for one in changed if one[1] != _SHARE]):
            own = table[(table["joint"] == joint) & (table["effect"] == effect)]
            own = own[own["parameter"] == parameter].drop_duplicates("session").set_index("session")
            what = f"{change_name(effect, joint)}, {parameter_name(parameter)}"
            name = f"{joint} {_SHARE}" if effect == _SHARE else what
            found[name] = own.reindex(sessions).assign(joint=joint, effect=effect)
        return found


def read_tracking(folder: str | Path) -> Tracking:
    """Read what tracking wrote.

    Raises
    ------
    InputError
        Where ``tracking.json`` or ``changes.parquet`` is missing or damaged.
    """
    outcome = read_json(Path(folder) / "tracking.json", missing="track the machine first")
    return Tracking(outcome, tables.read_table(Path(folder) / "changes.parquet"))


def write_tracking_page(folder: str | Path) -> None:
    """Write ``report.html`` next to the files of a tracked machine."""
    tables.write_text(Path(folder) / "report.html", render_tracking(read_tracking(folder)))


def render_tracking(tracking: Tracking) -> str:
    """Self-contained page of a tracked machine."""
    outcome, names = tracking.outcome, trend_names(tracking)
    trends = [
        {"slope": 100 * one["slope"], "ends": _ends(100 * end for end in one["ci95"])}
        | {"joint": one["joint"], "p": one["p"], "left": tell_left(one)}
        for one in outcome["trends"]
    ]
    columns = f"joint; slope|slope [% a session]; ends|95 %; p; left|sessions until {name_limit(outcome)}"
    caption = "Straight line through the later sessions. friction_limit of tracking sets the limit."
    slopes = render_table(trends, caption, filter_by=JOINT, columns=columns)
    table = trend_table(tracking)
    panels = list_panels(tracking, table)
    charts = [chart_panel(name, *panel) for name, panel in panels.items()]
    friction = embed_chart(*charts, chart_trend(names, table)) + (slopes if trends else "")
    events = [event for one in outcome["sessions"] for event in one.get("events", [])]
    notes = [one for one in outcome["notes"] if not one.endswith("an event, its rows are left out.")]
    sections = [
        Section("What changed", _outcome(tracking), "changed"),
        Section("Over the sessions", friction, "friction"),
        Section("Wear", _wear(outcome["wear"]), "wear"),
        Section("Session by session", _sessions(outcome["sessions"]), "sessions"),
        Section("Events", render_event_table(events, {}) if events else Markup(""), "events"),
        Section("The healthy machine", _healthy(outcome), "healthy"),
        Section("Notes", render_part(listed=notes), "notes"),
    ]
    return render_page(
        f"Tracked: {outcome['dataset']}",
        sections,
        f"{count_text(len(outcome['sessions']), 'session')} after "
        f"{count_text(len(outcome['reference']), 'healthy one')}; "
        f"false alarms in {100 * outcome['false_alarm_rate']:.3g} % of sessions",
        f"Made by wearscope {outcome['version'].partition(' (')[0]}.",
        [Choice("joint", "Joint", [(joint, joint) for joint in tracking.joints])],
        {"trend": table} | {name: rows for name, (*_, rows) in panels.items()},
        {"what": names},
        tracking_strip(tracking),
    )


def tracking_strip(tracking: Tracking) -> Strip:
    """Strip of the page: what changed in the last session, and what that session does not show."""
    told = describe(tracking)
    kind = "bad" if told.changes else "unsure" if told.hidden or told.passed else "good"
    answer, sure, caveat = (say(_WORDS, part, told).striptags() for part in ("answer", "sure", "caveat"))
    return Strip(answer, kind, sure, caveat, say(_WORDS, "action", told))


def describe(tracking: Tracking) -> SimpleNamespace:
    """Values of a tracked machine that the strip's template needs."""
    outcome, last = tracking.outcome, tracking.outcome["sessions"][-1]
    changes = [
        f"{change_name(one['effect'], one['joint'])} {_tell_size(tracking, one)}"
        + ("" if one["since"] == last["session"] else f" since {one['since']}")
        for one in list_first(last["changes"])
    ]
    unknown = {} if changes else tracking.open_changes()
    reason, _, remedy = next(iter(unknown.values()), "").partition(". ")
    return SimpleNamespace(
        session=last["session"],
        changes=join_some(changes, _MOST_TOLD),
        open=[(text.partition(":")[0], tracking.open_since(joint)) for joint, text in unknown.items()],
        reason=upper_first(reason.partition(": ")[2]).rstrip("."),
        remedy=remedy,
        hidden="".join(last["cannot_tell"][:1]).partition(". ")[0].rstrip("."),
        passed="" if changes else join_words(tracking.changed_before()),
        false=f"{100 * outcome['false_alarm_rate']:.3g}",
        events=len(join_events(last.get("events", []))),
        scattering=join_words([one["session"] for one in outcome["reference_scatter"]]),
        worn=(worn := {one["joint"] for one in last["changes"] if one["effect"] in _WEARS}),
        limits=tell_limits(tracking, worn),
    )


def list_first(changes: list[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The first parameter of each change; for a body that is its mass."""
    return list({(one["joint"], one["effect"]): one for one in reversed(changes)}.values())[::-1]


def _size(entry: Mapping[str, Any]) -> str:
    """Size of a change, with its sign and unit."""
    sign = "+" if entry["change"] > 0 else ""
    return f"{sign}{format_number(entry['change'])} {unit_text(entry['unit'])}".rstrip()


def _tell_size(tracking: Tracking, entry: Mapping[str, Any]) -> str:
    """Size of a change in the last session for the headline; for wear, the friction that it adds."""
    last = tracking.outcome["sessions"][-1]["session"]
    worn = [one for one in tracking.outcome["wear"] if one["session"] == last]
    levels = [
        one["level"] for one in worn if (one["joint"], one["effect"]) == (entry["joint"], entry["effect"])
    ]
    return f"(+{format_number(levels[0], 2)} % friction)" if levels else f"by {_size(entry)}"


def tell_left(trend: Mapping[str, Any]) -> str:
    """Number of sessions until a joint's friction reaches the limit at its present pace, in words."""
    left, low, high = np.ceil(np.array(trend.get("sessions_left", [None] * 3), dtype=float))
    if np.isnan(left):
        return "no sure rise"
    return interval_text(left, low, high) if left > 0.0 else "reached"


def name_limit(outcome: Mapping[str, Any]) -> str:
    """Words for the limit of the rise of friction, and whether it is assumed."""
    assumed = " (an assumed limit)" if outcome.get("friction_limit_assumed") else ""
    return f"+{100 * outcome.get('friction_limit', np.nan):.3g} % friction{assumed}"


def tell_limits(tracking: Tracking, joints: Container[str]) -> str:
    """When the friction of some joints reaches the limit, where it surely rises."""
    left = {one["joint"]: tell_left(one) for one in tracking.outcome["trends"] if one["joint"] in joints}
    return "".join(
        f"{joint} reaches {name_limit(tracking.outcome)} in {sessions} sessions at this pace. "
        for joint, sessions in left.items()
        if sessions[0].isdigit()
    )


def _ends(ends: Any) -> str:
    return " to ".join(format_number(end) for end in ends)


def tell_entry(entry: Mapping[str, Any]) -> str:
    """A change as one sentence."""
    name = f"{change_name(entry['effect'], entry['joint'])}: {parameter_name(entry['parameter'])}"
    rivals = [effect_name(one) for one in entry["equivalent"]]
    return say(_WORDS, "entry", entry, name, _size(entry), _ends(entry["ci95"]), rivals).striptags()


def _outcome(tracking: Tracking) -> Markup:
    """Section on the last session: changes, what it does not show, the smallest change it would show."""
    last = tracking.outcome["sessions"][-1]
    unknown = [*tracking.open_changes().values()]
    told = [text.partition(". ") for text in unknown]
    changes = [
        *(upper_first(tell_entry(entry)) for entry in last["changes"]),
        *(f"{text.rstrip('.')}." for text, *_ in told),
    ]
    named = {(entry["joint"], entry["effect"]) for entry in last["changes"]}
    changes += [
        f"This wear adds {format_number(one['level'], 2)} % to the friction of {one['joint']}."
        for one in tracking.outcome["wear"]
        if one["session"] == last["session"] and (one["joint"], one["effect"]) in named
    ]
    changes += filter(None, dict.fromkeys(remedy for *_, remedy in told))
    parts = [render_part(listed=changes or ["No change is sure."])]
    if hidden := [text for text in last["cannot_tell"] if text not in unknown]:
        parts += [Markup("<h3>What cannot be told</h3>"), render_part(listed=hidden)]
    seen = [
        {
            "joint": joint,
            **{f"{name} {unit}": scale * one[name] for name, unit, scale in _SEEN if name in one},
        }
        for joint, one in last["smallest_visible"].items()
    ]
    caption = (
        "Smallest change that this session would show. The mass is at the centre of the link that the joint "
        "moves."
    )
    parts.append(render_table(seen, caption, filter_by=JOINT))
    return render_part(parts=parts)


def _wear(found: list[dict[str, Any]]) -> Markup:
    """Wear of each joint by session, in the form that the simulator has."""
    records = [
        one
        | {
            "told": "; ".join(
                f"{parameter_name(name)} {interval_text(x['value'], *x['ci95'])} {unit_text(x['unit'])}"
                for name, x in one["parameters"].items()
            )
        }
        for one in found
    ]
    caption = (
        "Friction that wear adds, each parameter with its 95 % interval. model_tracked.yaml has the last one "
        "of each joint. A study or the target reevaluate can simulate it at any level."
    )
    columns = "session; joint; level|level [% of friction]; told|parameters (95 %)"
    table = render_table(records, caption, filter_by=JOINT, columns=columns)
    return table if records else Markup("")


def _sessions(found: list[dict[str, Any]]) -> Markup:
    records = [
        {
            "session": one["session"],
            "changes": " ".join(map(tell_entry, list_first(one["changes"])))
            or _tell_open(one["cannot_tell"]),
            "cannot tell": " ".join(f"{text.partition('. ')[0].rstrip('.')}." for text in one["cannot_tell"])
            or "nothing",
        }
        for one in found
    ]
    return render_table(records)


def _tell_open(texts: list[str]) -> str:
    """Text where no change is named: no change, or friction that changed by wear or temperature."""
    known = [text.partition(" changed by ")[0] for text in texts if text.startswith(_OPEN_FRICTION)]
    joints = join_words([one.removeprefix(_OPEN_FRICTION) for one in known])
    return f"changed, cause open: friction of {joints}" if joints else "none"


def _healthy(outcome: Mapping[str, Any]) -> Markup:
    healthy, scatter = outcome["healthy"], outcome["healthy"]["scatter"]
    records = []
    for joint, ends in healthy["temperatures"].items():
        terms = ", ".join(effect_name(one["effect"]) for one in healthy["terms"] if one["joint"] == joint)
        known = "not recorded" if ends is None else "{:.0f} to {:.0f}".format(*ends)
        records.append({"joint": joint, "terms": terms or "none", "temperatures [°C]": known})
    left = [
        f"{one['session']} scatters and was left out: at {one['joint']} it leaves "
        f"{format_number(one['rms'])}, the others {format_number(one['others'])} (RMS torque)."
        for one in outcome["reference_scatter"]
    ]
    text = (
        f"Reference: {join_words(outcome['reference'])}. Healthy sessions differ by "
        f"{100 * scatter['friction']:.2g} % of a joint's friction and {100 * scatter['torque']:.2g} % of its "
        f"torque (standard deviation, {scatter['sessions']} held out)."
    )
    table = render_table(records, "Terms of the healthy model.", filter_by=JOINT)
    return render_part(told=[text, *left], parts=[table])


def trend_table(tracking: Tracking) -> pd.DataFrame:
    """Friction in per cent of the healthy friction, and every other parameter that changed, by session.

    Columns: `session`, `value`, `low`, `high`, `state`, `joint`, `what` (a key of `trend_names`), `alarm`
    (where a change would be named; NaN where that is not known).
    """
    smallest = {one["session"]: one["smallest_visible"] for one in tracking.outcome["sessions"]}
    changes = {(session, one["joint"], one["effect"]) for session, one in tracking.entries()}
    unknown = {
        (one["session"], joint)
        for place, one in enumerate(tracking.outcome["sessions"])
        for joint in tracking.open_changes(place)
    }
    parts = []
    for name, rows in tracking.parameters().items():
        joint, effect = rows["joint"].iloc[0], rows["effect"].iloc[0]
        friction = effect == _SHARE
        share = 100.0 / float((rows["value"] - rows["change"]).median()) if friction else 1.0
        ends = {"value": "value", "value_low": "low", "value_high": "high"}
        table = share * rows[[*ends]].rename(columns=ends).astype(float)
        known = {(s, j) for s, j, e in changes if (e in _WEARS if friction else e == effect)}
        states = [
            _OPEN
            if friction and (one, joint) in unknown
            else "change named"
            if (one, joint) in known
            else "no change named"
            for one in rows.index
        ]
        seen = [smallest.get(one, {}).get(joint, {}).get(_SHARE, np.nan) for one in rows.index]
        table["alarm"] = 100.0 + 100.0 * np.array(seen) if friction else np.nan
        table["state"] = pd.Series(states, rows.index).mask(rows["healthy"].eq(True), "healthy, held out")
        parts.append(table.reset_index().assign(joint=joint, what=_SHARE if friction else name))
    return pd.concat(parts, ignore_index=True)


def trend_names(tracking: Tracking) -> dict[str, str]:
    """Titles with units of the quantities that can be drawn over the sessions."""
    others = {
        name: with_unit(name, str(rows["unit"].dropna().iloc[0]))
        for name, rows in tracking.parameters().items()
        if rows["effect"].iloc[0] != _SHARE
    }
    return {_SHARE: "friction [% of healthy]", **others}


def list_panels(tracking: Tracking, table: pd.DataFrame) -> dict[str, tuple[str, str, pd.DataFrame]]:
    """Panels of the quantities that changed in any session, by name: title, title of the axis, rows."""
    firsts = [one for session in tracking.outcome["sessions"] for one in list_first(session["changes"])]
    wanted: dict[tuple[str, str], None] = {}
    for one in firsts:
        what = f"{change_name(one['effect'], one['joint'])}, {parameter_name(one['parameter'])}"
        wanted[one["joint"], _SHARE if one["effect"] in _WEARS else what] = None
    for place in range(len(tracking.outcome["sessions"])):
        wanted |= {(joint, _SHARE): None for joint in tracking.open_changes(place)}
    names, panels = trend_names(tracking), {}
    for number, (joint, what) in enumerate([*wanted][:_MOST_PANELS]):
        rows = table[(table["joint"] == joint) & (table["what"] == what)].drop(columns="what")
        title = f"Friction of {joint}" if what == _SHARE else upper_first(what)
        axis = names[what] if what == _SHARE else names[what].rpartition(", ")[2]
        panels[f"panel-{number}"] = (title, axis, rows)
    return panels


def _draw_sessions(source: str, title: str, table: pd.DataFrame) -> Any:
    """Marks of values with intervals over the sessions, and of the value from which a change is named."""
    looks = {state: look for state, look in _STATES.items() if state in set(table["state"])}
    tints = dict(zip(_STATES, _TINTS, strict=True))
    base = named(source).encode(
        x=alt.X("session:N", title=None, sort=None, axis=alt.Axis(labelAngle=-50, labelOverlap=True)),
        color=tint("state:N", {state: tints[state] for state in looks}),
        tooltip=tips(
            f"joint:N; session:N; value:Q|{title}|.4; low:Q|95 % from|.4; high:Q|to|.4; "
            "alarm:Q|alarm from|.4; state:N"
        ),
    )
    y = alt.Y("value:Q", title=title, scale=alt.Scale(zero=False))
    shapes = alt.Scale(domain=[*looks], range=[*looks.values()])
    alarm = base.transform_filter("isValid(datum.alarm)").mark_rect(height=2, width=alt.RelativeBandSize(0.5))
    return alt.layer(
        base.mark_rule(strokeWidth=1.5).encode(y=alt.Y("low:Q", title=title), y2="high:Q"),
        alarm.encode(y="alarm:Q", color=alt.value("var(--bad)")),
        base.mark_point(size=60, opacity=1, filled=True).encode(
            y=y, shape=alt.Shape("state:N", title=None, scale=shapes)
        ),
    )


def chart_panel(name: str, title: str, axis: str, rows: pd.DataFrame) -> Chart:
    """Chart of one joint's quantity that changed, over the sessions."""
    drawing = _draw_sessions(name, axis, rows).properties(width="container", height=200)
    return Chart(f"{name}-chart", title, drawing, {name: Source(name, {"joint": "joint"})})


def chart_trend(names: Mapping[str, str], table: pd.DataFrame) -> Chart:
    """Chart of a joint's quantity that a reader chooses, over the sessions."""
    return Chart(
        "trend-chart",
        "Any joint",
        _draw_sessions("trend", "⟦what⟧", table).properties(width="container", height=240),
        {"trend": Source("trend", {"what": "what", "joint": "joint"})},
        "Red dash: friction from which a change would be named. Friction: RMS torque, compared with that of "
        "the healthy machine along the same motion. The 95 % intervals cover the session's noise, the error "
        "of the reference and the scatter of healthy sessions. Each healthy session is compared with the "
        "others. Where the temperature was not recorded, its effect is part of the friction.",
        [Choice("what", "Show", list(names.items()))],
        ["joint"],
    )
