"""The page of a tracked machine: what changed since it was healthy, and the trend of each joint."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from wearscope import tables
from wearscope.reporting.charts.base import Choice
from wearscope.reporting.charts.tracking import chart_trend, trend_names, trend_table
from wearscope.reporting.labels import count_text, join_words, unit_text, words
from wearscope.reporting.page import (
    Section,
    badge,
    embed_chart,
    format_number,
    interval_text,
    render_page,
    render_part,
    render_table,
)
from wearscope.reporting.sections.base import JOINT
from wearscope.reporting.strips import tracking_strip
from wearscope.reporting.tracking import Tracking, read_tracking


def write_tracking_page(folder: str | Path) -> None:
    """Write ``report.html`` next to the files of a tracked machine.

    Raises
    ------
    InputError
        Where nothing was tracked in that folder.
    """
    tables.write_text(Path(folder) / "report.html", render_tracking(read_tracking(folder)))


def render_tracking(tracking: Tracking) -> str:
    """Page of a tracked machine, with nothing from elsewhere."""
    outcome = tracking.outcome
    sections = [
        Section("What changed", _outcome(tracking), "changed"),
        Section("Friction and what changed", _friction(tracking), "friction"),
        Section("Wear", _wear(tracking), "wear"),
        Section("Session by session", _sessions(tracking), "sessions"),
        Section("The healthy machine", _healthy(outcome), "healthy"),
        Section("Notes", render_part(listed=outcome["notes"]), "notes"),
    ]
    later = len(outcome["sessions"])
    subtitle = (
        f"{count_text(later, 'session')} after {count_text(len(outcome['reference']), 'healthy one')}; "
        f"false alarms in {100 * outcome['false_alarm_rate']:.3g} % of sessions"
    )
    title = f"Tracked: {outcome['dataset']}"
    footer = f"Made by wearscope {outcome['version']}."
    filters = [Choice("joint", "Joint", [(joint, joint) for joint in tracking.joints])]
    found, labels = {"trend": trend_table(tracking)}, {"what": trend_names(tracking)}
    return render_page(
        title, sections, subtitle, footer, filters, found, labels, strip=tracking_strip(tracking)
    )


def tell_entry(entry: Mapping[str, Any]) -> str:
    """A change as one sentence."""
    low, high = (format_number(x) for x in entry["ci95"])
    unit = unit_text(entry["unit"])
    said = (
        f"{words(entry['effect'])} of {entry['joint']}: {words(entry['parameter'])} "
        f"{'+' if entry['change'] > 0 else ''}{format_number(entry['change'])} {unit}".rstrip()
        + f" (95 %: {low} to {high}), since {entry['since']}"
    )
    if entry["equivalent"]:
        said += f"; {words(join_words(entry['equivalent'], 'or'))} would explain it as well"
    return said + "."


def _outcome(tracking: Tracking) -> Markup:
    last = tracking.outcome["sessions"][-1]
    changes = [tell_entry(entry) for entry in last["changes"]]
    parts = [render_part(told=[("", f"In the last session, {last['session']}:")], listed=changes)]
    if not changes:
        parts.append(badge("no change", "good"))
    if last["cannot_tell"]:
        parts += [Markup("<h3>What cannot be told</h3>"), render_part(listed=last["cannot_tell"])]
    files = [one["cycle_file"] for one in last["next_measurement"] if "cycle_file" in one]
    passed = list(dict.fromkeys(one for one, _ in tracking.entries() if one != last["session"]))
    told = [f"Test-cycles to record: {join_words(files)}."] if files else []
    told += [f"Earlier sessions with a change: {join_words(passed)}."] if passed else []
    return render_part(parts=[*parts, render_part(told=[("", one) for one in told])])


def _friction(tracking: Tracking) -> Markup:
    chart = embed_chart(chart_trend(tracking))
    trends = [
        {
            "joint": one["joint"],
            "slope [% a session]": 100 * one["slope"],
            "95 %": f"{format_number(100 * one['ci95'][0])} to {format_number(100 * one['ci95'][1])}",
            "p": one["p"],
        }
        for one in tracking.outcome["trends"]
    ]
    if not trends:
        return chart
    return chart + render_table(trends, "Straight line through the later sessions.", filter_by=JOINT)


def _wear(tracking: Tracking) -> Markup:
    """Wear of each joint by session, in the form that the simulator has."""
    records = []
    for one in tracking.outcome["wear"]:
        told = [
            f"{name} {interval_text(x['value'], *x['ci95'])} {unit_text(x['unit'])}"
            for name, x in one["parameters"].items()
        ]
        records.append(
            {
                "session": one["session"],
                "joint": one["joint"],
                "level [% of friction]": one["level"],
                "parameters (95 %)": "; ".join(told),
            }
        )
    if not records:
        return Markup("")
    caption = (
        "What wear adds to friction at a level f, each parameter with its 95 % interval. "
        "model_tracked.yaml has each joint's last one: it can be simulated, at any level, as a robot of a "
        "study or one side of the target reevaluate."
    )
    return render_table(records, caption, filter_by=JOINT)


def _sessions(tracking: Tracking) -> Markup:
    records = [
        {
            "session": one["session"],
            "changes": " ".join(tell_entry(entry) for entry in one["changes"]) or "none",
            "cannot tell": " ".join(one["cannot_tell"]) or "nothing",
        }
        for one in tracking.outcome["sessions"]
    ]
    return render_table(records)


def _healthy(outcome: Mapping[str, Any]) -> Markup:
    healthy = outcome["healthy"]
    by_joint: dict[str, list[str]] = {joint: [] for joint in healthy["temperatures"]}
    for term in healthy["terms"]:
        by_joint[term["joint"]].append(term["effect"])
    records = [
        {
            "joint": joint,
            "terms": words(", ".join(terms)) or "none",
            "temperatures [°C]": "not recorded"
            if healthy["temperatures"][joint] is None
            else "{:.0f} to {:.0f}".format(*healthy["temperatures"][joint]),
        }
        for joint, terms in by_joint.items()
    ]
    scatter = healthy["scatter"]
    text = (
        f"Reference: {join_words(outcome['reference'])}. Healthy sessions differ by "
        f"{100 * scatter['friction']:.2g} % of a joint's friction and {100 * scatter['torque']:.2g} % of its "
        f"torque (standard deviation, {scatter['sessions']} held out)."
    )
    return render_part(
        told=[("", text)],
        parts=[render_table(records, "Terms of the healthy model.", filter_by=JOINT)],
    )
