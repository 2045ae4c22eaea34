"""A card for each joint of a diagnosis: what became of its error, what is left, and small curves of both."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.effects.vocabulary import list_effects
from wearscope.reporting.closed_loop import ClosedLoop, gap_closed, number
from wearscope.reporting.closed_loop_details import write_value
from wearscope.reporting.labels import join_words
from wearscope.reporting.page import badge, unbreak

#: Colour and word of what became of the error, and of what is left.
_ERRORS = {"smaller": "good", "same": "neutral", "larger": "bad"}
_LEFT = {
    "explained": ("good", "noise"),
    "corrected": ("good", "noise"),
    "unexplained": ("bad", "structure"),
    "not_judged": ("unsure", "not judged"),
}
#: Share by which an error must change to be called other than the same.
_SAME = 0.03
#: Of the small curves: width, height, seconds and points.
_WIDTH, _HEIGHT, _SECONDS, _POINTS = 320, 64, 8.0, 240
_CURVES = (
    ("measured", "var(--soft)"),
    ("predicted_before", "var(--before)"),
    ("predicted_after", "var(--after)"),
)


def render_joint_cards(loop: ClosedLoop) -> Markup:
    """Cards of all joints, with a line on the colours of their curves."""
    cards = Markup("").join(_card(loop, joint) for joint in loop.joints)
    note = (
        "Grey: measured torque of a test run; orange: the declared model; blue: the corrected one. Left: "
        "what the corrected model does not predict. It is noise, or structure that repeats with the motion, "
        "depends on a signal, or is larger on the test runs than on those for training. Not judged: no row "
        "of the test runs counts, or the error is above half of the torque."
    )
    return Markup('<h3>Joint by joint</h3><div class="cards">{}</div><p class="note">{}</p>').format(
        cards, note
    )


def list_shared() -> set[str]:
    """Effects that the robot has once and every joint feels."""
    return {effect.name for effect in list_effects() if effect.per_robot}


def _card(loop: ClosedLoop, joint: str) -> Markup:
    one = loop.verdict["joints"][joint]
    own = [entry["effect"] for entry in loop.entries_at(joint)]
    shared = [e["effect"] for e in loop.verdict["verdict"] if e["effect"] in list_shared() - set(own)]
    named = [name.replace("_", " ") for name in own]
    named += [f"{name.replace('_', ' ')} of the robot" for name in shared]
    kind, word = _LEFT[one["state"]]
    change = tell_change(one)
    lines = [
        Markup("<p><strong>Error</strong> {} {}</p>").format(
            badge(_tell_growth(one, change), _ERRORS.get(change, "neutral")), unbreak(_tell_sizes(one))
        ),
        Markup("<p><strong>Left</strong> {} {}</p>").format(badge(word, kind), unbreak(_tell_left(one))),
    ]
    title = f"{joint}: {join_words(named) if named else 'nothing added'}"
    return Markup('<div class="card {}" data-joint="{}"><h3>{}</h3>{}{}</div>').format(
        "bad" if change == "larger" else kind, joint, title, Markup("").join(lines), draw_curves(loop, joint)
    )


def tell_change(one: Mapping[str, Any]) -> str:
    """What became of a joint's error: ``smaller``, ``same``, ``larger``; empty where it is not known."""
    if one.get("error"):
        return str(one["error"])
    before, after = number(one.get("rms_before")), number(one.get("rms_after"))
    if not np.isfinite([before, after]).all():
        return ""
    if abs(after - before) <= _SAME * before:
        return "same"
    return "smaller" if after < before else "larger"


def _tell_growth(one: Mapping[str, Any], change: str) -> str:
    if change != "larger":
        return change or "n/a"
    return f"larger by {100 * (number(one['rms_after']) / number(one['rms_before']) - 1):.0f} %"


def _tell_sizes(one: Mapping[str, Any]) -> str:
    before, after, floor = (number(one.get(key)) for key in ("rms_before", "rms_after", "noise_floor"))
    if not np.isfinite([before, after]).all():
        return "the joint does not move on the test runs"
    told = f"{write_value(before)} → {write_value(after)}"
    if abs(after - before) <= 1e-6 * before:
        told = str(write_value(before))
    gap = gap_closed(one)[1]
    if gap.endswith("%"):
        return f"{told} {one['unit']} RMS, {gap} of the gap to the noise floor closed"
    return f"{told} {one['unit']} RMS" + (f", noise floor {write_value(floor)}" if np.isfinite(floor) else "")


def _tell_left(one: Mapping[str, Any]) -> str:
    """How much is left, on what it depends, how it was seen."""
    share = number(one.get("left_percent"))
    told = f"{share:.2g} % of the torque" if np.isfinite(share) else ""
    if one["state"] == "unexplained":
        on = one["depends_on"]
        depends = f"depending on {join_words(on)}" if on else "on what it depends is not known"
        size = f"{write_value(number(one['unexplained_rms']))} {one['unit']} RMS, {depends}"
        told = f"{size}; in all {told}" if told else size
    if one["state"] in ("unexplained", "not_judged") and one["reason"]:
        told = f"{told} ({one['reason']})" if told else str(one["reason"])
    return told


def draw_curves(loop: ClosedLoop, joint: str) -> Markup:
    """Measured torque and both predictions over the first seconds of a test run; nothing without one."""
    table = loop.residual
    own = table[(table["joint"] == joint) & (table["use"] == "test")]
    names = [name for name, _ in _CURVES]
    if own.empty or not set(names) <= set(own.columns):
        return Markup("")
    rows = own[own["run"] == own["run"].iloc[0]]
    rows = rows[rows["t"] - rows["t"].iloc[0] <= _SECONDS]
    rows = rows.iloc[:: max(1, len(rows) // _POINTS)]
    values = rows[names].to_numpy(dtype=float)
    if len(rows) < 2 or not np.isfinite(values).any():
        return Markup("")
    paths = Markup("").join(
        Markup('<path d="{}" fill="none" stroke="{}" stroke-width="{}"/>').format(
            _path(rows["t"], rows[name], float(np.nanmin(values)), float(np.nanmax(values))),
            colour,
            3 if name == "measured" else 1.3,
        )
        for name, colour in _CURVES
    )
    return Markup('<svg viewBox="0 0 {} {}" class="curves" role="img" aria-label="{}">{}</svg>').format(
        _WIDTH, _HEIGHT, f"Measured and predicted torque of {joint} over {_SECONDS:g} s", paths
    )


def _path(t: pd.Series, torque: pd.Series, low: float, high: float) -> str:
    """Path of a curve in the small frame, broken where a value is missing."""
    x = (t - t.iloc[0]).to_numpy(dtype=float)
    x = _WIDTH * x / max(float(x[-1]), 1e-9)
    y = (_HEIGHT - 4) * (high - torque.to_numpy(dtype=float)) / max(high - low, 1e-12) + 2
    parts, pen = [], "M"
    for one, other in zip(x, y, strict=True):
        if not np.isfinite(other):
            pen = "M"
            continue
        parts.append(f"{pen}{one:.1f} {other:.1f}")
        pen = "L"
    return "".join(parts)
