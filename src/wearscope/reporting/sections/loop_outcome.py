"""The first parts of a closed loop's page: what was named, the next measurement, events."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from wearscope.reporting.closed_loop import ClosedLoop, name_signal, number
from wearscope.reporting.labels import UNKNOWN, join_words, unit_text, words
from wearscope.reporting.loop_words import (
    PROMISED,
    STATUSES,
    is_small,
    list_alarms,
    list_shared,
    say_share,
    size_left,
    tell_left,
    tell_measurement,
    tell_sizes,
)
from wearscope.reporting.page import format_number, render_table, render_template
from wearscope.reporting.sections.base import JOINT, LoopSection

_CHANGES = {"smaller": "good", "same": "neutral", "larger": "bad"}
_LEFT = {
    "explained": ("good", "noise left"),
    "corrected": ("good", "noise left"),
    "unexplained": ("unsure", "structure left"),
    "not_judged": ("unsure", "not judged"),
}
_SMALL = ("good", "small structure left")
#: Of the small curves: width, height, seconds and points; colour and width of each.
_WIDTH, _HEIGHT, _SECONDS, _POINTS = 320, 64, 8.0, 240
_CURVES = {
    "measured": ("var(--soft)", 3),
    "predicted_before": ("var(--before)", 1.3),
    "predicted_after": ("var(--after)", 1.3),
}


class Outcome(LoopSection):
    """What was named, what the test runs say of it, what is left at each joint, the rule."""

    title, anchor, template = "Outcome", "outcome", "loop/outcome.html"

    def context(self) -> dict[str, Any]:
        """Cards of effects by status and of joints, alarms, parameters, rule."""
        records = [record for entry in self.verdict["verdict"] for record in _list_parameters(entry)]
        text = (
            "Parameters of what was added; the models hold them all. The interval of one parameter may hold "
            "zero where those of its effect together do not."
        )
        return {
            "groups": [self._group(name) for name in STATUSES],
            "alarms": list_alarms(self.verdict),
            "named": bool(self.verdict["verdict"]),
            "joints": [self._joint(joint) for joint in self.loop.joints],
            "count": len(records),
            "parameters": render_table(records, text, filter_by=JOINT) if records else "",
        }

    def _group(self, status: str) -> dict[str, Any]:
        own = [one for j in self.loop.joints for one in self.loop.entries_at(j) if one["status"] == status]
        own.sort(key=lambda entry: entry["effect"] == UNKNOWN)
        said = STATUSES[status]
        return {"heading": said.heading, "kind": said.kind, "cards": [_card(one) for one in own]}

    def _joint(self, joint: str) -> dict[str, Any]:
        one, shared = self.verdict["joints"][joint], list_shared()
        own = [entry["effect"] for entry in self.loop.entries_at(joint)]
        others = [e["effect"] for e in self.verdict["verdict"] if e["effect"] in shared - set(own)]
        named = [*map(words, own), *(f"{words(name)} of the robot" for name in others)]
        change, (kind, word) = one["error"], _SMALL if is_small(one) else _LEFT[one["state"]]
        told = change or "n/a"
        if change == "larger":
            told = f"larger by {100 * (number(one['rms_after']) / number(one['rms_before']) - 1):.0f} %"
        return {
            "joint": joint,
            "named": join_words(named) or "nothing added",
            "kind": "bad" if change == "larger" else kind,
            "change": told,
            "change_kind": _CHANGES.get(change, "neutral"),
            "sizes": tell_sizes(one),
            "word": ", ".join(filter(None, [word, size_left(one)])),
            "left_kind": kind,
            "left": tell_left(one),
            "curves": draw_curves(self.loop, joint),
        }


def _card(entry: Mapping[str, Any]) -> dict[str, Any]:
    where = "all joints together" if entry["effect"] in list_shared() else entry["joint"]
    lines = [f"{STATUSES[entry['status']].sentence}: {say_share(entry)} at {where}."]
    if entry["effect"] == UNKNOWN:
        lines.append("Structure that no named effect explains.")
    if entry["depends_on"]:
        lines.append(f"Depends on {join_words([*map(name_signal, entry['depends_on'])])}.")
    names = {"joint": entry["joint"], "effect": words(entry["effect"])}
    return names | {"lines": lines, "equivalent": words(join_words(entry["equivalent"], "or"))}


def _list_parameters(entry: Mapping[str, Any]) -> list[dict[str, str]]:
    """Rows of the table: fitted parameters, a spline's heights as one, fixed ones."""
    where = {"joint": entry["joint"], "effect": words(entry["effect"])}
    heights = [one["value"] for name, one in entry["parameters"].items() if name.startswith("height")]

    def row(name: str, value: str, interval: str, unit: str = "") -> dict[str, str]:
        return where | {
            "parameter": words(name),
            "value": value,
            "95 % interval": interval,
            "unit": unit_text(unit),
        }

    if entry["effect"] == UNKNOWN and heights:
        told = f"{format_number(min(heights))} to {format_number(max(heights))}"
        unit = next(iter(entry["parameters"].values()))["unit"]
        return [row(f"{len(heights)} heights of a spline", told, "n/a", unit)]
    rows = []
    for name, one in entry["parameters"].items():
        low, high = (format_number(number(v)) for v in one["ci95"])
        rows.append(row(name, format_number(number(one["value"])), f"{low} to {high}", one["unit"]))
    return rows + [row(name, format_number(number(v)), "fixed") for name, v in entry["fixed"].items()]


def draw_curves(loop: ClosedLoop, joint: str) -> Markup:
    """Measured torque and both predictions over the first seconds of a test run; nothing without one."""
    table = loop.residual
    own = table[(table["joint"] == joint) & (table["use"] == "test")]
    if own.empty or not set(_CURVES) <= set(own.columns):
        return Markup("")
    rows = own[own["run"] == own["run"].iloc[0]]
    rows = rows[rows["t"] - rows["t"].iloc[0] <= _SECONDS]
    rows = rows.iloc[:: max(1, len(rows) // _POINTS)]
    values = rows[list(_CURVES)].to_numpy(dtype=float)
    if len(rows) < 2 or not np.isfinite(values).any():
        return Markup("")
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    x = (rows["t"] - rows["t"].iloc[0]).to_numpy(dtype=float)
    x = _WIDTH * x / max(float(x[-1]), 1e-9)
    y = (_HEIGHT - 4) * (high - values) / max(high - low, 1e-12) + 2
    return render_template(
        "loop/curves.html",
        width=_WIDTH,
        height=_HEIGHT,
        label=f"Measured and predicted torque of {joint} over {_SECONDS:g} s",
        paths=[(_path(x, y[:, k]), *look) for k, look in enumerate(_CURVES.values())],
    )


def _path(x: np.ndarray, y: np.ndarray) -> str:
    """Path of a curve in the small frame, broken where a value is missing."""
    known = np.isfinite(y)
    begins = known & ~np.concatenate([[False], known[:-1]])
    return "".join(
        f"{'M' if begins[k] else 'L'}{x[k]:.1f} {y[k]:.1f}" for k in np.flatnonzero(known).tolist()
    )


class NextMeasurement(LoopSection):
    """What to record next."""

    title, anchor, template = "The next measurement", "next-measurement", "loop/measurement.html"

    def context(self) -> dict[str, Any]:
        """Advised runs with their files; nothing where every name is alone."""
        told = {"table": "for a controller", "cycle_file": "for the simulator"}
        entries = [
            {
                "joint": one["joint"],
                "kind": "good" if one["power"] >= PROMISED else "unsure",
                "text": tell_measurement(one),
                "files": [(one[key], what) for key, what in told.items() if key in one],
            }
            for one in self.verdict.get("next_measurement") or []
        ]
        return {"entries": entries} if entries else {}


class Events(LoopSection):
    """Short events, and a collision detector's threshold."""

    title, anchor = "Events", "events"

    def context(self) -> dict[str, Any]:
        """Tables of events and of thresholds; nothing where the verdict has none."""
        events, thresholds = (self.verdict.get(key) for key in ("events", "collision_thresholds"))
        if not events and not thresholds:
            return {}
        units = {joint: one["unit"] for joint, one in self.verdict["joints"].items()}
        found = [
            {"joint": one["joint"], "run": one["run"], "starts at [s]": one["t"], "lasts [s]": one["seconds"]}
            | {"torque that the model lacks": one["size"], "unit": units.get(one["joint"], "")}
            for one in events or []
        ]
        limits = [
            {"joint": joint, "threshold": one["threshold"], "unit": units.get(joint, "")}
            | {"false alarms per hour, at most": one["false_alarms_per_hour_at_most"]}
            for joint, one in (thresholds or {}).items()
        ]
        note = (
            "Pushes or collisions that the corrected model does not predict. Their rows count in no fit."
            if found
            else "No push and no collision was seen."
        )
        told = (
            "Of a collision detector: the largest torque that the model misses on test runs without events."
        )
        return {
            "notes": [note],
            "parts": [render_table(found, filter_by=JOINT | {"run": "run"})] if found else [],
            "folded": [("Collision thresholds", False, render_table(limits, told, filter_by=JOINT))]
            if limits
            else [],
        }
