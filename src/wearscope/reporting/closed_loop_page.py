"""The page of a closed loop: its strip, effects that the model lacked, next measurement, events, errors."""

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
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
from wearscope.reporting.closed_loop import (
    STAGES,
    ClosedLoop,
    against_signal,
    bounded,
    dominant_signals,
    join_events,
    label_signal,
    name_signal,
    number,
    read_closed_loop,
    render_event_table,
)
from wearscope.reporting.labels import (
    UNKNOWN,
    count_text,
    effect_name,
    join_words,
    parameter_name,
    parameter_units,
    unit_text,
    upper_first,
)
from wearscope.reporting.loop_words import (
    PROMISED,
    SLIGHT,
    STATUSES,
    conclude_loop,
    doubt_masses,
    falls_anywhere,
    is_in_model,
    is_small,
    joints_in,
    list_alarms,
    list_shared,
    list_unexplained,
    say_share,
    size_left,
    tell_left,
    tell_load,
    tell_measurement,
    tell_noise,
    tell_rivals,
    tell_sizes,
    tell_unexplained,
    tell_why,
)
from wearscope.reporting.page import (
    JOINT,
    Section,
    embed_chart,
    format_number,
    render_page,
    render_part,
    render_table,
    render_template,
    say,
)
from wearscope.reporting.page_strip import Strip
from wearscope.storage import tables

_CHANGES = {"smaller": "good", "same": "neutral", "larger": "bad"}
_LEFT = {
    "explained": ("good", "noise left"),
    "corrected": ("good", "noise left"),
    "unexplained": ("unsure", "structure left"),
    "not_judged": ("unsure", "not judged"),
}
_WORDS = "loop/strip.html"
#: Largest bound on the false alarms per hour that is worth showing.
_MOST_ALARMS = 60.0
#: Width and height of a card's picture; largest number of points in it.
_WIDTH, _HEIGHT, _POINTS = 320, 76, 200


def loop_strip(loop: ClosedLoop) -> Strip:
    """Strip of the page: what the model lacks, and whether the correction makes it better."""
    kind, text = conclude_loop(loop.verdict)
    told = describe(loop)
    sure, caveat = (say(_WORDS, part, told).striptags() for part in ("sure", "caveat"))
    return Strip(text, kind, sure, caveat, say(_WORDS, "action", told))


def describe(loop: ClosedLoop) -> SimpleNamespace:
    """Values of a closed loop that the strip's template needs."""
    verdict, entries, joints = loop.verdict, loop.verdict["verdict"], loop.verdict["joints"]
    statuses, unjudged = [one["status"] for one in entries], joints_in(verdict, "not_judged")
    left = list_unexplained(verdict, small=False)
    worst = max(left, key=lambda joint: number(joints[joint].get("left_percent") or 0.0), default="")
    curves = [one for one in entries if one["effect"] == UNKNOWN and is_in_model(one)]
    advised = [one for one in verdict.get("next_measurement") or [] if "table" in one]
    return SimpleNamespace(
        named=len(entries),
        held=statuses.count("confirmed"),
        refuted=statuses.count("refuted"),
        falls=falls_anywhere(verdict),
        events=len(join_events(verdict.get("events") or [])),
        unjudged=join_words(unjudged),
        reason=joints[unjudged[0]].get("reason", "") if unjudged else "",
        masses=doubt_masses(verdict),
        load=tell_load(verdict),
        rivals=tell_rivals(verdict),
        worst=worst,
        size=size_left(joints[worst]) if worst else "",
        why=tell_why(joints[worst]) if worst else "",
        curve=curves[0]["joint"] if curves else "",
        over=join_words([*map(name_signal, curves[0]["depends_on"])]) if curves else "",
        small=upper_first(tell_unexplained(verdict, small=True)),
        noise=tell_noise(verdict),
        runs=int(loop.residual.loc[loop.residual["use"] == "train", "run"].nunique()),
        advised=advised,
        unasked="next_measurement" not in verdict and any(one["equivalent"] for one in entries),
        kept=any(map(is_in_model, entries)),
        body=any(map(is_in_model, entries)) and any(one["effect"] in list_shared() for one in entries),
        doubt=doubt_simulation(loop.forward),
        apart=join_words(verdict.get("contradictory_runs") or []),
    )


def doubt_simulation(forward: pd.DataFrame | None) -> str:
    """Doubts about the corrected model in a simulator, and its remaining use; empty without any.

    Parameters
    ----------
    forward : DataFrame or None
        As ``forward.parquet``.
    """
    if forward is None:
        return ""
    whole = forward[forward["run"] == "all"].set_index(["stage", "joint"])
    before, after = whole.loc["before"], whole.loc["after"]
    failed = after["outcome"][(before["outcome"] == "ok") & (after["outcome"] != "ok")]
    worse = after.index[after["motion_rms_low"] > before["motion_rms_high"]]
    if failed.empty and worse.empty:
        return ""
    reason = "".join(one.partition("failed: ")[2] or one for one in failed[:1])
    joint = (after["motion_rms"] / before["motion_rms"])[worse].idxmax() if len(worse) else ""
    ends = [format_number(one["motion_rms"].get(joint), 2) for one in (after, before)]
    return say(_WORDS, "doubt", reason, joint, *ends)


def render_outcome(loop: ClosedLoop) -> Markup:
    """Cards: one for effects of the whole robot and one for each joint, the worst first."""
    once = [one for one in loop.verdict["verdict"] if one["effect"] in list_shared()]
    cards = [{"title": "The robot", "joint": "", "effects": _tell_effects(loop, once)}] if once else []
    cards += [describe_joint(loop, joint) for joint in loop.joints]
    cards = [card | {"kind": _colour(card)} for card in cards]
    return render_template(
        "loop/outcome.html",
        alarms=list_alarms(loop.verdict),
        named=bool(loop.verdict["verdict"]),
        cards=sorted(cards, key=lambda card: card["kind"] != "bad"),
    )


def render_parameters(loop: ClosedLoop) -> Markup:
    """All fitted parameters, joint by joint, then those of the bodies; empty without any."""
    kept = filter(is_in_model, loop.verdict["verdict"])
    added = [record for entry in kept for record in _list_parameters(loop, entry)]
    rows = [row | {"before": "not in it"} for row in added] + _list_fitted(loop)
    rows.sort(key=lambda row: loop.joints.index(row["joint"]) if row["joint"] in loop.joints else -1)
    text = (
        "Before: the declared model, its own parameters fitted to the training runs. After: with what was "
        "added. An interval includes shapes and friction without a name, so it may hold zero."
    )
    masses = (
        "Links and payload: declared by the robot's URDF, and as the models have them. Centres of mass lie "
        "in the link's frame. Runs determine combinations of masses only: a single mass has no interval."
    )
    columns = "joint; effect; parameter; before; value|after; 95 % interval; unit"
    parts = [render_table(rows, text, filter_by=JOINT, columns=columns)] if rows else []
    links = _list_links(loop)
    return render_part(parts=[*parts, *([render_table(links, masses)] if links else [])])


def _list_fitted(loop: ClosedLoop) -> list[dict[str, str]]:
    """Rows of the parameters of effects that both models have: Coulomb, viscous, rotor inertia, delays."""
    if len(loop.models) < 2:
        return []
    before, after = (
        {(one["joint"], one["effect"]): one for one in loop.models[stage]["effects"]} for stage in STAGES
    )
    rows = []
    for (joint, effect), one in after.items():
        own = before.get((joint, effect), {}).get("parameters", {})
        units = parameter_units(effect, loop.verdict["joints"].get(joint, {}).get("unit", "N m"))
        for name, value in one.get("parameters", {}).items() if own else ():
            ends = one.get("intervals", {}).get(name, (None, None))
            interval = " to ".join(format_number(number(end)) for end in ends)
            rows.append(
                {"joint": joint, "effect": effect_name(effect), "parameter": parameter_name(name)}
                | {"before": format_number(number(own.get(name))), "value": format_number(number(value))}
                | {"95 % interval": "fixed" if None in ends else interval, "unit": units.get(name, "")}
            )
    return rows


def _list_links(loop: ClosedLoop) -> list[dict[str, Any]]:
    """Rows of the links that have a mass, and of the payload: mass and centre of mass by stage."""
    bodies = {stage: dict(links) for stage, links in loop.links.items()}
    if payload := loop.models.get("after", {}).get("payload"):
        stated = payload["mass"], tuple(map(number, payload["com"]))
        bodies = {stage: links | {"payload, as declared": stated} for stage, links in bodies.items()}
    rows = []
    for name in (name for name, (mass, _) in bodies.get("after", {}).items() if mass > 0.0):
        own = {stage: links[name] for stage, links in bodies.items() if name in links}
        masses = {f"mass {stage} [kg]": mass for stage, (mass, _) in own.items()}
        places = {
            f"centre of mass {stage} [m]": ", ".join(format_number(round(one, 3)) for one in place)
            for stage, (_, place) in own.items()
            if stage != "before"
        }
        rows.append({"body": name, **masses, **places})
    return rows


def describe_joint(loop: ClosedLoop, joint: str) -> dict[str, Any]:
    """Card of a joint: named effects, error before and after, remaining structure, small curves."""
    one = loop.verdict["joints"][joint]
    kind, word = ("good", "small structure left") if is_small(one) else _LEFT[one["state"]]
    change = told = one["error"] or "n/a"
    if change == "smaller" and number(one["rms_after"]) > (1.0 - SLIGHT) * number(one["rms_before"]):
        change = told = "same"
    if change == "larger":
        growth = number(one["rms_after"]) / number(one["rms_before"]) - 1.0
        told = f"larger by {100 * growth:.{0 if growth > SLIGHT else 1}f} %"
        change = "same" if growth <= SLIGHT else change
    own = [entry for entry in loop.entries_at(joint) if entry["effect"] not in list_shared()]
    return {
        "title": joint,
        "joint": joint,
        "effects": _tell_effects(loop, own),
        "change": told,
        "change_kind": _CHANGES.get(change, "neutral"),
        "sizes": tell_sizes(one),
        "word": ", ".join(filter(None, [word, size_left(one)])),
        "left_kind": kind,
        "left": tell_left(one),
        "curves": draw_curves(loop, joint),
    }


def _tell_effects(loop: ClosedLoop, entries: list[Mapping[str, Any]]) -> list[dict[str, str]]:
    """Each effect: its name, the result of the test runs, its first fitted parameter."""
    told = []
    for entry in entries:
        rivals = [effect_name(name) for name in entry["equivalent"]]
        where = " at all joints together" if entry["effect"] in list_shared() else ""
        fitted = [
            row for row in _list_parameters(loop, entry) if row["95 % interval"] not in ("fixed", "n/a")
        ]
        on = [name_signal(name) for name in entry["depends_on"]] if entry["effect"] == UNKNOWN else None
        kept, status = is_in_model(entry), entry["status"]
        text = say("loop/words.html", "effect", entry, rivals, say_share(entry), where, fitted, on, kept)
        kind = STATUSES[status] if kept or status == "refuted" else "unsure"
        told.append(
            {"name": upper_first(effect_name(entry["effect"])), "kind": kind}
            | {"status": status.replace("_", " "), "text": text}
        )
    return told


def _colour(card: Mapping[str, Any]) -> str:
    """Colour of a card: that of its worst part."""
    kinds = [one["kind"] for one in card["effects"]] + [card.get("left_kind"), card.get("change_kind")]
    return next(kind for kind in ("bad", "unsure", "good") if kind in kinds)


def _list_parameters(loop: ClosedLoop, entry: Mapping[str, Any]) -> list[dict[str, str]]:
    """Rows of fitted parameters, one for a spline's heights; fixed parameters follow the effect's name."""
    rows = [
        (
            parameter_name(name),
            format_number(number(one["value"])),
            " to ".join(format_number(number(end)) for end in one["ci95"]),
            unit_text(one["unit"]),
        )
        for name, one in entry["parameters"].items()
    ]
    heights = [one["value"] for name, one in entry["parameters"].items() if name.startswith("height")]
    if entry["effect"] == UNKNOWN and heights:
        told = f"{format_number(min(heights))} to {format_number(max(heights))}"
        rows = [(f"{len(heights)} heights of a spline", told, "n/a", rows[0][-1])]
    units = parameter_units(
        entry["effect"], loop.verdict["joints"].get(entry["joint"], {}).get("unit", "N m")
    )
    fixed = [
        f"{parameter_name(name)} {format_number(number(value))} {units.get(name, '')}".strip()
        for name, value in entry["fixed"].items()
    ]
    told = f" ({', '.join(fixed)})" if fixed else ""
    where = {"joint": entry["joint"], "effect": f"{effect_name(entry['effect'])}{told}"}
    names = ("parameter", "value", "95 % interval", "unit")
    return [where | dict(zip(names, row, strict=True)) for row in rows]


def draw_curves(loop: ClosedLoop, joint: str) -> Markup:
    """Residual before and after over the signal that it depends on most; nothing where no row counts."""
    seen = [] if loop.signals is None else [*dominant_signals(loop, joint, most=1), f"qd_{joint}"]
    signal = [*seen, "t"][0]
    rows = against_signal(loop, joint, signal)
    rows = rows.iloc[:: max(1, len(rows) // _POINTS)]
    x, y = rows["x"].to_numpy(dtype=float), rows[["residual_before", "residual_after"]].to_numpy(dtype=float)
    if len(rows) < 2 or not np.isfinite(y).all():
        return Markup("")
    (left, right), size = (float(x.min()), float(x.max())), max(float(np.abs(y).max()), 1e-12)
    across = _WIDTH * (x - left) / max(right - left, 1e-12)
    down = _HEIGHT * (size - y) / (2 * size)
    paths = [
        ("".join(f"M{u:.0f} {v:.1f}h0" for u, v in zip(across, down[:, k], strict=True)), colour)
        for k, colour in enumerate(("var(--before)", "var(--after)"))
    ]
    return render_template(
        "loop/curves.html",
        width=_WIDTH,
        height=_HEIGHT,
        paths=paths,
        label=f"Residual of {joint} over {label_signal(loop, signal)}",
        ends=(format_number(left), format_number(right)),
        size=f"±{format_number(size)} {loop.verdict['joints'][joint]['unit']}",
        signal=label_signal(loop, signal),
    )


def render_measurement(loop: ClosedLoop) -> Markup:
    """Advised runs with their files; empty where the runs tell all names apart."""
    told = {"table": "for a controller", "cycle_file": "for the simulator"}
    entries = [
        {
            "joint": one["joint"],
            "kind": "good" if one["power"] >= PROMISED else "unsure",
            "badge": "separates them" if one["power"] >= PROMISED else "may not separate them",
            "text": tell_measurement(one),
            "files": [(one[key], what) for key, what in told.items() if key in one],
        }
        for one in loop.verdict.get("next_measurement") or []
    ]
    return render_template("loop/measurement.html", entries=entries)


def _tell_rate(most: float) -> str:
    """False alarms that a threshold allows; unknown where the test runs are too short to tell."""
    return (
        f"at most {format_number(most)} an hour" if most <= _MOST_ALARMS else "not known: record longer runs"
    )


def render_events(loop: ClosedLoop) -> Markup:
    """Short events, and a collision detector's threshold; nothing where the verdict has none."""
    events, thresholds = (loop.verdict.get(key) for key in ("events", "collision_thresholds"))
    if not events and not thresholds:
        return Markup("")
    units = {joint: one["unit"] for joint, one in loop.verdict["joints"].items()}
    limits = [
        {"joint": joint, "threshold": one["threshold"], "unit": units.get(joint, "")}
        | {"false alarms": _tell_rate(one["false_alarms_per_hour_at_most"])}
        for joint, one in (thresholds or {}).items()
    ]
    note = (
        "Pushes or collisions that the corrected model does not predict, in the recording's own time. "
        "Their rows count in no fit."
    )
    told = "Of a collision detector: the largest torque that the model misses on test runs without events."
    return render_part(
        notes=[note if events else "No push and no collision was seen."],
        parts=[render_event_table(events, units)] if events else [],
        folded=[("Collision thresholds", False, render_table(limits, told, filter_by=JOINT))] * bool(limits),
    )


#: Longest list that is shown unfolded.
MOST_SHOWN = 12


def write_closed_loop_page(folder: str | Path, urdf: str | Path = "") -> None:
    """Write ``report.html`` next to the files of a closed loop on a robot that a URDF declares."""
    tables.write_text(Path(folder) / "report.html", render_closed_loop(read_closed_loop(folder, urdf)))


def render_closed_loop(loop: ClosedLoop) -> str:
    """Self-contained page of a closed loop."""
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
        f"Made by wearscope {loop.verdict['version'].partition(' (')[0]}.",
        loop_filters(loop),
        drawn,
        loop_labels(loop),
        loop_strip(loop),
    )


def _errors(loop: ClosedLoop, drawn: pd.DataFrame) -> Markup:
    """Section on the errors on the test runs."""
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
    """Section with charts of torque and residual over time and over signals."""
    joint = loop.foremost()
    runs = loop.residual.loc[loop.residual["use"] == "test", "run"]
    charts = charts_over_time(loop, joint, str(runs.iloc[0]) if len(runs) else "")
    return embed_chart(*charts, chart_against(loop, joint))


def _forward(loop: ClosedLoop) -> Markup:
    """Section that compares the forward simulations of both models with the measurement."""
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
    """Section on effects that the runs leave undetermined, and the motion that would show each."""
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
    """Section with the verdict's notes, and the share of rows that do not count."""
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
