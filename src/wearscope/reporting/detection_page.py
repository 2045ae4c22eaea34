"""The page of detectors on recordings: alarms first, then every value on one axis with the simulated ones."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from wearscope import tables
from wearscope.reporting.charts.base import Choice
from wearscope.reporting.charts.detection import axis_tables, chart_axis
from wearscope.reporting.detection import (
    Detections,
    conclude,
    read_detections,
    tell_factors,
    tell_scatter,
    write_quantity,
)
from wearscope.reporting.labels import count_text, join_words
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
from wearscope.reporting.strips import detection_strip

_BADGES = {
    "alarm": "bad",
    "no alarm": "good",
    "unchecked": "unsure",
    "withheld": "unsure",
    "failed": "neutral",
}
#: Columns of the tables, by the page's filters that they follow.
_FILTERS = {"motion": "motion", "joint": "joint", "detector": "fda"}
#: Rows of a table that is shown unfolded.
_MOST_SHOWN = 40


def write_detection_page(folder: str | Path) -> None:
    """Write ``report.html`` next to the files of target ``detect``.

    Raises
    ------
    InputError
        Where they are not there.
    """
    tables.write_text(Path(folder) / "report.html", render_detection(read_detections(folder)))


def render_detection(found: Detections) -> str:
    """Page of the detectors on the recordings of a data set, with nothing from elsewhere."""
    setting = found.summary["setting"]
    sections = [
        Section("Outcome", _outcome(found), "outcome"),
        Section("Machine and simulator", embed_chart(chart_axis()), "axis"),
        Section("Every test quantity", _values(found), "values"),
        Section("Thresholds, and what they detect", _thresholds(found), "thresholds"),
        Section("Not judged, and why", _refused(found), "refused"),
        Section("How it was done", _setting(found), "setting"),
    ]
    judged = found.judged["run"].nunique()
    subtitle = (
        f"{count_text(judged, 'recording')} judged by "
        f"{count_text(found.thresholds['fda'].nunique(), 'detector')} at a false-alarm rate of "
        f"{100 * setting['p_f']:g} %"
    )
    title = f"Detectors on recordings: {found.summary['dataset']}"
    cells = found.thresholds
    filters = [
        Choice(key, name, [(one, one) for one in dict.fromkeys(cells[key])])
        for key, name in {"motion": "Motion", "joint": "Joint", "fda": "Detector"}.items()
    ]
    labels = {"column": {"fda": "detector", "place": "place on the axis", "y": "test quantity"}}
    strip = detection_strip(found)
    return render_page(
        title, sections, subtitle, filters=filters, tables=axis_tables(found), labels=labels, strip=strip
    )


def _outcome(found: Detections) -> Markup:
    told = [("" if kind == "plain" else kind, sentence) for kind, sentence in conclude(found)]
    return render_part(told=told + [("", one) for one in [*tell_scatter(found), *tell_factors(found)]])


def _fold(rows: Sequence[Mapping[Any, Any]], caption: str, summary: str) -> Markup:
    by = {name: key for name, key in _FILTERS.items() if rows and name in rows[0]}
    table = render_table(rows, caption, filter_by=by)
    if len(rows) <= _MOST_SHOWN:
        return table
    return render_part(folded=[(summary, False, table)])


def _values(found: Detections) -> Markup:
    order = {verdict: k for k, verdict in enumerate(_BADGES)}
    rows = found.judged.assign(order=found.judged["verdict"].map(order))
    rows = rows[rows["status"] == "ok"].sort_values(["order", "run"], kind="stable")
    records = [
        {
            "recording": row["run"],
            "session": row["session"],
            "joint": row["joint"],
            "detector": row["fda"],
            "verdict": badge(row["verdict"], _BADGES[row["verdict"]]),
            "test quantity": write_quantity(row["y"], row["unit"]),
            "threshold": write_quantity(row["threshold"], row["unit"]),
            "warmer by [K]": row["warmer"],
            "wear like it (95 %)": interval_text(row["wear"], row["wear_low"], row["wear_high"], 2),
        }
        for row in rows.to_dict("records")
    ]
    caption = (
        "Wear like it: the simulated wear that gives such a test quantity. detection.parquet has the nominal "
        "recordings too."
    )
    return _fold(records, caption, f"All {len(records)} values")


def _thresholds(found: Detections) -> Markup:
    records = [
        {
            "motion": row["motion"],
            "joint": row["joint"],
            "detector": row["fda"],
            "threshold": write_quantity(row["threshold"], row["unit"]),
            "false-alarm rate (95 %)": interval_text(row["p_f"], row["p_f_low"], row["p_f_high"], 2),
            "wear detected from": row["wear_detected"],
            "nominal recordings": row["nominal_runs"],
            "of them above": row["nominal_above"],
            "the simulated scatter is": row["scatter"],
        }
        for row in found.thresholds[found.thresholds["reason"] == ""].to_dict("records")
    ]
    p_d = 100 * found.summary["setting"]["p_d"]
    caption = (
        "Threshold: a simulated run without wear exceeds it at most at the false-alarm rate. Wear detected "
        f"from: smallest wear of which {p_d:g} % of simulated runs exceed it; n/a where there is none. "
        "Scatter: whether nominal recordings lie where simulated runs lie."
    )
    return _fold(records, caption, "All thresholds")


def _refused(found: Detections) -> Markup:
    rows = found.thresholds[found.thresholds["reason"] != ""]
    without = [
        f"{fda} at {join_words(sorted(own['joint'].unique()))}: {str(reason).rstrip('.')}."
        for (fda, reason), own in rows.groupby(["fda", "reason"], sort=True)
    ]
    return render_part(listed=[one["reason"] for one in found.summary["refused"]] + without)


def _setting(found: Detections) -> Markup:
    setting, summary = found.summary["setting"], found.summary
    fitted = (
        "the nominal recordings"
        if setting["nominal"] == "measured"
        else "simulated runs of the corrected model"
    )
    sentences = [
        f"For the recordings the detectors were fitted to {fitted}; for simulated runs, to simulated nominal "
        "runs.",
        f"{setting['runs']} runs without wear and {setting['worn_runs']} with wear of the model "
        f"{summary['model']} were simulated along each motion, at the recorded temperatures. Temperature and "
        f"payload mass error scatter by {setting['sigma']:g} coded units of the study; the torque noise is "
        f"that of {summary['torque_noise_from']}. Recorded and simulated runs were filtered alike.",
    ]
    for motion, one in summary["motions"].items():
        named = f"{motion[0].upper()}{motion[1:]}, {format_number(one['seconds'])} s"
        sentences.append(f"{named}: nominal {', '.join(one['nominal'])}.")
    return render_part(told=[("", one) for one in sentences])
