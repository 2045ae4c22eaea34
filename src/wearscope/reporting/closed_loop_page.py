"""The page of a closed loop: effects that the model lacked, errors before and after, and certainty."""

from pathlib import Path

import pandas as pd
from markupsafe import Markup

from wearscope.reporting.charts.loop import (
    chart_against,
    chart_errors,
    charts_over_time,
    loop_filters,
    loop_labels,
    loop_tables,
)
from wearscope.reporting.closed_loop import STAGES, ClosedLoop, bounded, number, read_closed_loop
from wearscope.reporting.labels import count_text, effect_name, join_words
from wearscope.reporting.loop_outcome import (
    loop_strip,
    render_events,
    render_measurement,
    render_outcome,
    render_parameters,
)
from wearscope.reporting.page import (
    JOINT,
    Section,
    embed_chart,
    render_page,
    render_part,
    render_table,
)
from wearscope.storage import tables

#: Longest list that is shown unfolded.
MOST_SHOWN = 12


def write_closed_loop_page(folder: str | Path, urdf: str | Path = "") -> None:
    """Write ``report.html`` next to the files of a closed loop on a robot that a URDF declares."""
    tables.write_text(Path(folder) / "report.html", render_closed_loop(read_closed_loop(folder, urdf)))


def render_closed_loop(loop: ClosedLoop) -> str:
    """Page of a closed loop, with nothing from elsewhere."""
    drawn = loop_tables(loop)
    sections = [
        Section("Outcome", render_outcome(loop), "outcome"),
        Section("The next measurement", render_measurement(loop), "next-measurement"),
        Section("Errors on the test runs", _errors(loop, drawn["errors"]), "errors"),
        Section("Parameters", render_parameters(loop), "parameters"),
        Section("Events", render_events(loop), "events"),
        Section("Residual", _residual(loop), "residual"),
        Section("Simulated forward", _forward(loop), "forward"),
        Section("What these runs cannot tell", _undetermined(loop), "undetermined"),
        Section("Notes", _notes(loop), "notes"),
    ]
    runs = loop.residual.groupby("use")["run"].nunique()
    return render_page(
        f"Diagnosis of {loop.verdict['dataset']}",
        sections,
        f"{count_text(len(loop.joints), 'joint')}, {count_text(int(runs.get('train', 0)), 'training run')}, "
        f"{count_text(int(runs.get('test', 0)), 'test run')}. Parameters and choices come from the training "
        "runs, errors from the test runs.",
        f"Made from the tables of a loop closed by wearscope {loop.verdict['version'].partition(' (')[0]}.",
        loop_filters(loop),
        drawn,
        loop_labels(loop),
        loop_strip(loop),
    )


def _errors(loop: ClosedLoop, drawn: pd.DataFrame) -> Markup:
    """Errors on the test runs."""
    relative = [
        {"joint": joint, "test run": run, "before [%]": number(before), "after [%]": number(after)}
        for joint, one in loop.verdict["joints"].items()
        for run, (before, after) in one.get("relative_error_percent", {}).items()
    ]
    note = "RMS of the residual over RMS of the torque, in the rows that count."
    rest = render_table(relative, note, filter_by=JOINT | {"test run": "run"})
    return render_part(
        parts=[embed_chart(chart_errors(loop, drawn))],
        folded=[("Relative error of every test run", len(relative) <= MOST_SHOWN, rest)],
    )


def _residual(loop: ClosedLoop) -> Markup:
    """Torque and residual over time and signals."""
    joint = loop.foremost()
    runs = loop.residual.loc[loop.residual["use"] == "test", "run"]
    charts = charts_over_time(loop, joint, str(runs.iloc[0]) if len(runs) else "")
    return embed_chart(*charts, chart_against(loop, joint))


def _forward(loop: ClosedLoop) -> Markup:
    """Both models simulated forward, and the measurement."""
    table = loop.forward
    if table is None:
        return Markup("")
    rows = table[table["run"] == "all"].set_index(["joint", "stage"])
    records = []
    for joint in loop.joints:
        unit = loop.verdict["joints"][joint]["unit"]
        record = {"joint": joint, "unit": unit}
        for kind, scale in (("torque", 1.0), ("motion", 1e3)):
            for stage in STAGES:
                own = scale * rows.loc[(joint, stage), [f"{kind}_rms{end}" for end in ("", "_low", "_high")]]
                value, *ends = own.astype(float)
                record[f"{kind} {stage}"] = bounded(value, ends)
        records.append(record | {"motion in": "mm" if unit == "N" else "mrad"})
    text = (
        "Both models follow the measured motion of the test runs in PyBullet under the same controller. "
        "Torque: its feedforward is computed from the model before; the measured torque has no part in it. "
        "Motion: its feedforward is the measured torque, and a right model stays on the measured motion."
    )
    note = "RMS error against the measurement on the test runs (95 %)."
    return render_part(notes=[text], parts=[render_table(records, note, filter_by=JOINT)])


def _undetermined(loop: ClosedLoop) -> Markup:
    """What the runs could not tell, and the motion that would help."""
    grouped: dict[tuple[str, str, str], list[str]] = {}
    for one in loop.verdict.get("undetermined") or []:
        grouped.setdefault((one["effect"], one["reason"], one["motion"]), []).append(one["joint"])
    rows = [
        {"joints": _where(loop, joints), "effect": effect_name(effect)}
        | {"why not": reason, "would help": motion}
        for (effect, reason, motion), joints in grouped.items()
    ]
    if not rows:
        return Markup("")
    untested = render_table(rows, "What could not be tested, or can be hidden.")
    if len(rows) <= MOST_SHOWN:
        return untested
    title = f"{len(rows)} effects that could not be tested, or can be hidden"
    return render_part(folded=[(title, False, untested)])


def _where(loop: ClosedLoop, joints: list[str]) -> str:
    every = len(joints) > 1 and set(joints) >= set(loop.joints)
    return "all joints" if every else join_words(joints)


def _notes(loop: ClosedLoop) -> Markup:
    """Notes of the verdict, rows that do not count."""
    counted = loop.residual.groupby(["run", "joint"], sort=False)["counts"].mean()
    left_out = [
        {"run": run, "joint": joint, "rows that do not count [%]": 100 * (1 - share)}
        for (run, joint), share in counted.items()
        if share < 0.8
    ]
    notes = loop.verdict.get("notes", [])
    how_many = count_text(len(left_out), "run and joint", "runs and joints")
    summary = f"Rows that do not count: {how_many} with more than a fifth"
    why = "Rows at rest, at the torque limit, or without a measurement."
    folded = [(summary, False, render_table(left_out, why, 2, JOINT))] if left_out else []
    return render_part(listed=notes, notes=[] if notes else ["None."], folded=folded)
