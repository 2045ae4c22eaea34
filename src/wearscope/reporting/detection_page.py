"""The page of detectors on recordings: alarms first, then every value on one axis with the simulated ones."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from markupsafe import Markup

from wearscope import tables
from wearscope.reporting.detection import (
    Detections,
    conclude,
    read_detections,
    tell_factors,
    tell_scatter,
    write_quantity,
)
from wearscope.reporting.figures.detection import draw_detection
from wearscope.reporting.labels import count_text
from wearscope.reporting.page import (
    Section,
    badge,
    embed_figure,
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
        Section("Machine and simulator on one axis", _axis(found), "axis"),
        Section("Every test quantity", _values(found), "values"),
        Section("Thresholds, and what they detect", _thresholds(found), "thresholds"),
        Section("Not judged", _refused(found), "refused"),
        Section("How it was asked", _setting(found), "setting"),
    ]
    judged = found.judged["run"].nunique()
    subtitle = (
        f"{count_text(judged, 'recording')} judged by "
        f"{count_text(found.thresholds['fda'].nunique(), 'detector')} at a wanted false-alarm rate of "
        f"{setting['p_f']:g}"
    )
    title = f"Detectors on recordings: {found.summary['dataset']}"
    return render_page(title, sections, subtitle, strip=detection_strip(found))


def _outcome(found: Detections) -> Markup:
    told = [("" if kind == "plain" else kind, sentence) for kind, sentence in conclude(found)]
    return render_part(told=told + [("", one) for one in [*tell_scatter(found), *tell_factors(found)]])


def _axis(found: Detections) -> Markup:
    simulated = found.simulated[found.simulated["kind"] != "compared"]
    columns = ["motion", "joint", "fda", "kind", "y"]
    rows = pd.concat([simulated[columns], found.detection[columns]], ignore_index=True)
    figures = []
    for motion, cells in found.thresholds.groupby("motion", sort=False):
        caption = (
            f"Test quantities of {motion} in their own unit. Boxes: simulated runs, each box half of what "
            "lies beyond the one within; their detectors were fitted to simulated nominal runs. Points: "
            "recordings; nominal ones are asked of detectors fitted to the other nominal ones. Dashed: alarm "
            "threshold."
        )
        alt = f"Simulated and recorded test quantities of {motion} with alarm thresholds"
        figures.append(embed_figure(draw_detection(rows[rows["motion"] == motion], cells), alt, caption))
    names = {
        "motion": "motion", "joint": "joint", "fda": "detector", "nominal_runs": "nominal recordings",
        "nominal_above": "of them above the threshold",
        "scatter_ratio": "distance from the simulated median, machine over simulator",
        "scatter_p_adjusted": "adjusted p", "scatter": "the simulated scatter is",
    }  # fmt: skip
    caption = (
        "Distances of nominal test quantities from their common median, compared by rank (Mann and Whitney), "
        "p adjusted over all rows (Holm)."
    )
    table = found.thresholds[list(names)].rename(columns=names)
    return _fold(table.to_dict("records"), caption, "Whose scatter it is", figures)


def _fold(
    rows: Sequence[Mapping[Any, Any]], caption: str, summary: str, before: Sequence[Markup] = ()
) -> Markup:
    table = render_table(rows, caption)
    if len(rows) <= _MOST_SHOWN:
        return render_part(parts=[*before, table])
    return render_part(parts=before, folded=[(summary, False, table)])


def _values(found: Detections) -> Markup:
    records = []
    order = {verdict: k for k, verdict in enumerate(_BADGES)}
    rows = found.detection.assign(order=found.detection["verdict"].map(order))
    for row in rows.sort_values(["kind", "order", "run"], kind="stable").to_dict("records"):
        judged = row["kind"] == "judged"
        records.append(
            {
                "recording": row["run"],
                "session": row["session"],
                "joint": row["joint"],
                "detector": row["fda"],
                "y": write_quantity(row["y"], row["unit"]) if row["status"] == "ok" else row["status"],
                "threshold": write_quantity(row["threshold"], row["unit"]),
                "verdict": badge(row["verdict"], _BADGES[row["verdict"]]) if judged else badge("nominal"),
                "p, simulated": row["p_value"],
                "p, machine": row["p_machine"],
                "warmer [K]": row["warmer"],
                "wear like it (95 %)": interval_text(row["wear"], row["wear_low"], row["wear_high"], 2),
            }
        )
    caption = (
        "p, simulated: share of simulated runs without wear that reach y, at least 1 / (runs + 1); p, "
        "machine: the same of the nominal recordings. Wear like it: of a wear drawn evenly from the fault's "
        "range, given y."
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
            "simulated runs": row["runs"],
            "wear detected from": row["wear_detected"],
            "why there is none": row["reason"],
        }
        for row in found.thresholds.to_dict("records")
    ]
    p_d = 100 * found.summary["setting"]["p_d"]
    caption = (
        "Threshold: the simulated value without wear that a further such run reaches with at most the "
        "wanted probability; in brackets, what that of this threshold may be. Wear detected from: smallest "
        f"wear from which on {p_d:g} % of the simulated worn runs reach the threshold; n/a where wear moves "
        "nothing or not even the most worn run does."
    )
    return _fold(records, caption, "All thresholds")


def _refused(found: Detections) -> Markup:
    return render_part(listed=[one["reason"] for one in found.summary["refused"]])


def _setting(found: Detections) -> Markup:
    setting, summary = found.summary["setting"], found.summary
    fitted = (
        "the nominal recordings"
        if setting["nominal"] == "measured"
        else "simulated runs of the corrected model"
    )
    sentences = [
        f"The detectors were fitted to {fitted} before they were asked for the recordings, and to simulated "
        "nominal runs before they were asked for simulated runs.",
        f"{setting['runs']} runs without wear and {setting['worn_runs']} with wear of the model "
        f"{summary['model']} were simulated along each motion as recorded, at the recorded temperatures, "
        f"with temperature and payload mass error scattered by {setting['sigma']:g} coded units of the "
        f"study; their torque noise is that of {summary['torque_noise_from']}. Recorded and simulated runs "
        "were filtered alike, and cut from the first to the last motion.",
    ]
    for motion, one in summary["motions"].items():
        named = f"{motion[0].upper()}{motion[1:]}, {format_number(one['seconds'])} s"
        sentences.append(f"{named}: nominal {', '.join(one['nominal'])}.")
    return render_part(told=[("", one) for one in sentences])
