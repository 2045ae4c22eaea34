"""Sections of a closed loop's page beyond its outcome: candidates, isolability, simulation, the rest."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.effects.vocabulary import list_effects
from wearscope.reporting.charts.loop import chart_angles, chart_candidates, chart_forward
from wearscope.reporting.closed_loop import STAGES, ClosedLoop, bounded
from wearscope.reporting.labels import UNKNOWN, count_text, join_words
from wearscope.reporting.page import embed_chart, format_number, render_table, unbreak

#: As `wearscope.closed_loop.diagnostics.isolability.CLOSE`, which this room does not know.
_CLOSE = 7.0
#: Longest list that is shown unfolded.
MOST_SHOWN = 12


def list_items(parts: Iterable[Any]) -> Markup:
    """Bullet list."""
    return Markup("<ul>{}</ul>").format(Markup("").join(Markup("<li>{}</li>").format(part) for part in parts))


def _note(text: str) -> Markup:
    return Markup('<p class="note">{}</p>').format(unbreak(text))


def say_missing(what: str) -> Markup:
    """Sentence for a section without its table."""
    return _note(f"{what} was not examined: the loop was closed without it.")


def write_value(value: float) -> str:
    """Number as pages write it."""
    return format_number(float(value))


def describe_candidates(loop: ClosedLoop) -> Markup:
    """Ranking of the candidates at every step, and what was made of each."""
    chart = chart_candidates(loop)
    if chart is None:
        return _note("There was no candidate to try.")
    standard = {effect.name for effect in list_effects() if effect.standard}
    steps = []
    for step, rows in loop.candidates.groupby("step", sort=True):
        taken = rows[rows["taken"]]
        labels = list(dict.fromkeys(taken["joint"] + ": " + taken["effect"]))
        what = f"took {join_words(labels)}" if labels else "took nothing"
        # Of the stage of the standard terms only what was kept is recorded.
        first = bool(rows["taken"].all()) and set(rows["effect"]) <= standard
        kind = " (standard terms)" if first else " (generic term)" if set(rows["effect"]) == {UNKNOWN} else ""
        steps.append(f"Step {int(step) + 1}{kind}: {what}")
    text = (
        "Every candidate is fitted together with all parameters of the model and scored on held-out "
        "training runs; one is taken only if it gains enough, is significant with all candidates counted, "
        "and the runs agree. What was taken may still be dropped or replaced when later terms are added, get "
        "the name of a simpler term that does as well, or be left out because its parameters are not told "
        "from zero. Too little gained is too little of the joint's held-out loss, of what the standard "
        "model leaves there, or of the joint's torque (numbers of the rule, under Outcome). "
        "candidates.parquet has them all."
    )
    return Markup("{}{}{}").format(_note(text), embed_chart(chart), list_items(steps))


def describe_isolability(loop: ClosedLoop) -> Markup:
    """Which candidates the runs tell apart."""
    if loop.isolability is None:
        return say_missing("Which effects the runs separate")
    text = (
        "Angles between the candidates' torques along the training runs once the declared model is "
        "projected out, before anything is fitted: 0 where one reproduces the other, 90 where they have "
        "nothing in common. On the diagonal the angle to the declared model, which absorbs what lies "
        "near 0. Effects with free shapes are compared at the shapes where they are most alike."
    )
    parts = [_note(text)]
    chart = chart_angles(loop, loop.foremost())
    if chart is not None:
        parts.append(embed_chart(chart))
    rows = []
    for joint, own in loop.isolability.groupby("joint", sort=False):
        close = own[own["largest_angle_deg"] < _CLOSE]
        said = [f"{row.effect_a} and {row.effect_b}" for row in close.itertuples()]
        rows.append({"joint": joint, f"not separated (less than {_CLOSE:g}°)": "; ".join(said) or "none"})
    return Markup("").join(parts) + render_table(pd.DataFrame(rows), filter_by={"joint": "joint"})


def describe_forward(loop: ClosedLoop) -> Markup:
    """Both models simulated forward, and the measurement."""
    if loop.forward is None:
        return say_missing("Forward simulation")
    failed = loop.forward[(loop.forward["run"] != "all") & (loop.forward["outcome"] != "ok")]
    alarms = [
        Markup('<div class="alarm">{}, model {}: {}</div>').format(run, stage, outcome)
        for run, stage, outcome in failed[["run", "stage", "outcome"]]
        .drop_duplicates()
        .itertuples(index=False)
    ]
    rows = loop.forward[loop.forward["run"] == "all"]
    records = []
    for joint in loop.joints:
        unit = loop.verdict["joints"][joint]["unit"]
        record = {"joint": joint, "unit": unit}
        for kind, text, scale in (("torque", "torque", 1.0), ("motion", "motion", 1e3)):
            for stage in STAGES:
                one = rows[(rows["joint"] == joint) & (rows["stage"] == stage)].iloc[0]
                name = f"{kind}_rms"
                interval = [scale * one[f"{name}_low"], scale * one[f"{name}_high"]]
                record[f"{text} {stage}"] = bounded(scale * one[name], interval, write_value)
        records.append(record | {"motion in": "mm" if unit == "N" else "mrad"})
    chart = chart_forward(loop, loop.foremost())
    shown = embed_chart(chart) if chart is not None else Markup("")
    text = (
        "Both models follow the measured motion of the test runs in PyBullet under the same controller. "
        "Torque: the controller feeds forward what the model before needs, so that it owes nothing to "
        "the measured torque. Motion: it feeds forward the torque that was measured, and a model that "
        "is right stays on the measured motion."
    )
    table = render_table(
        pd.DataFrame(records),
        "RMS error against the measurement on the test runs (95 %).",
        filter_by={"joint": "joint"},
    )
    return Markup("{}{}{}{}").format(Markup("").join(alarms), _note(text), table, shown)


def describe_rest(loop: ClosedLoop) -> Markup:
    """What a black box still finds."""
    if loop.black_box is None:
        return say_missing("What a black box explains")
    records = []
    for joint in loop.joints:
        record: dict[str, Any] = {"joint": joint, "unit": loop.verdict["joints"][joint]["unit"]}
        for stage in STAGES:
            row = loop.black_box[
                (loop.black_box["joint"] == joint) & (loop.black_box["stage"] == stage)
            ].iloc[0]
            interval = [row["rms_black_box_low"], row["rms_black_box_high"]]
            record[f"residual {stage}"] = write_value(row["rms"])
            record[f"black box on {stage}"] = bounded(row["rms_black_box"], interval, write_value)
            if stage == "after":
                record["variance it still finds [%]"] = (
                    100 * row["share_removed"] if np.isfinite(row["share_removed"]) else np.nan
                )
        records.append(record)
    text = (
        "Gradient-boosted trees on position, speed, direction, acceleration, load, temperature and time "
        "of all joints, grown on the residuals of the training runs and asked for those of the test "
        "runs. What they still find in the residual after is structure that was left unnamed; a "
        "negative share says that what they learnt does not carry over."
    )
    return Markup("{}{}").format(
        _note(text),
        render_table(pd.DataFrame(records), "RMS on the test runs (95 %).", filter_by={"joint": "joint"}),
    )


def describe_undetermined(loop: ClosedLoop) -> Markup:
    """What the runs could not tell, and motions that would."""
    undetermined, advice = loop.verdict.get("undetermined"), loop.verdict.get("advice")
    if undetermined is None or advice is None:
        return say_missing("What was not determined")
    parts = []
    if undetermined:
        grouped: dict[tuple[str, str, str], list[str]] = {}
        for one in undetermined:
            grouped.setdefault((one["effect"], one["reason"], one["motion"]), []).append(one["joint"])
        rows = [
            {"joints": join_words(joints), "effect": effect, "why not": reason, "what would help": motion}
            for (effect, reason, motion), joints in grouped.items()
        ]
        parts.append(render_table(pd.DataFrame(rows), "What could not be asked of these runs."))
    if advice:
        rows = [{"motion": a["motion"], "separates": _shorten(a["separates"])} for a in advice]
        parts.append(render_table(pd.DataFrame(rows), "Motions that would separate what these runs do not."))
    return Markup("").join(parts) or _note("Nothing: every candidate was separable from every other.")


def _shorten(pairs: list[str]) -> str:
    """Pairs without the joints they are at, how often each occurs."""
    counts: dict[str, list[str]] = {}
    for pair in pairs:
        joint, _, names = pair.partition(": ")
        counts.setdefault(names, []).append(joint)
    said = [f"{names} ({join_words(joints)})" for names, joints in counts.items()]
    return "; ".join(said[:MOST_SHOWN]) + (
        f"; {len(said) - MOST_SHOWN} more" if len(said) > MOST_SHOWN else ""
    )


def describe_notes(loop: ClosedLoop) -> Markup:
    """What a reader should know of the data."""
    notes = list(loop.verdict.get("notes", []))
    counted = loop.residual.groupby(["run", "joint"], sort=False)["counts"].mean()
    left_out = [
        f"{run}: {100 * (1 - share):.0f} % of the rows of {joint} do not count (at rest, at the "
        "torque limit, or no measurement)."
        for (run, joint), share in counted.items()
        if share < 0.8
    ]
    body = list_items(map(unbreak, notes)) if notes else _note("None.")
    if left_out:
        body += Markup("<details><summary>{}</summary>{}</details>").format(
            f"Rows that do not count: {count_text(len(left_out), 'run and joint', 'runs and joints')} with "
            "more than a fifth",
            list_items(map(unbreak, left_out)),
        )
    return body
