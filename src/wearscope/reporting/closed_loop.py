"""Files of a closed loop, read for its page, and short events of recordings."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.reporting.page import format_number, interval_text, render_table
from wearscope.storage import tables
from wearscope.storage.files import read_json
from wearscope.storage.plain_yaml import load_plain_yaml

STAGES = ("before", "after")
_OPTIONAL = ("signals", "profiles", "forward")
#: Signals by their code: name and unit.
_SIGNALS = {
    "q": ("position", "{position}"),
    "qd": ("speed", "{position}/s"),
    "qdd": ("acceleration", "{position}/s²"),
    "load": ("rigid-body torque", "{torque}"),
    "temp": ("temperature", "°C"),
    "tau": ("torque", "{torque}"),
    "dtau": ("rate of the torque", "{torque}/s"),
    "reversal_load": ("load since the last reversal", ""),
    "reversal": ("motion since the last reversal", ""),
    "sign_qd": ("direction", ""),
    "wear": ("wear", ""),
}


@dataclass(frozen=True)
class ClosedLoop:
    """Outcome of one closed loop: ``verdict.json`` and its tables, None where the loop made none.

    `models` holds the model files by stage. `links` holds mass [kg] and centre of mass [m] of each link by
    stage; the stage ``declared`` is the robot's own URDF, where it is known.
    """

    verdict: Mapping[str, Any]
    residual: pd.DataFrame
    signals: pd.DataFrame | None = None
    profiles: pd.DataFrame | None = None
    forward: pd.DataFrame | None = None
    models: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    links: Mapping[str, Mapping[str, tuple[float, tuple[float, ...]]]] = field(default_factory=dict)

    @property
    def joints(self) -> list[str]:
        """Joint names, in the data set's order."""
        return list(self.verdict["joints"])

    def entries_at(self, joint: str) -> list[Mapping[str, Any]]:
        """Entries of the verdict at a joint."""
        return [entry for entry in self.verdict["verdict"] if entry["joint"] == joint]

    def foremost(self) -> str:
        """The joint shown first: that of a confirmed effect, else the first by `rank`."""

        def rank(joint: str) -> tuple[int, float]:
            """Joints with a refuted effect, then unexplained, then named ones, then by the largest error."""
            statuses = {entry["status"] for entry in self.entries_at(joint)}
            one = self.verdict["joints"][joint]
            unexplained = one["state"] == "unexplained"
            ranked = ("refuted" in statuses, unexplained, bool(statuses))
            shares = one.get("relative_error_percent", {}).values()
            errors = [-before for before, _ in shares if before is not None]
            return (ranked.index(True), 0.0) if any(ranked) else (len(ranked), min(errors, default=1.0))

        named = [entry["joint"] for entry in self.verdict["verdict"] if entry["status"] == "confirmed"]
        return str(named[0]) if named else min(self.joints, key=rank)


def read_closed_loop(folder: str | Path, urdf: str | Path = "") -> ClosedLoop:
    """Read a closed loop's files, and the URDF that the robot was declared by.

    Raises
    ------
    InputError
        Where ``verdict.json`` or ``residual.parquet`` is missing or damaged.
    """
    verdict = read_json(Path(folder) / "verdict.json", missing="close the loop first")
    files = {name: Path(folder) / f"{name}.parquet" for name in ("residual", *_OPTIONAL)}
    known = {name for name, file in files.items() if name not in _OPTIONAL or file.exists()}
    found = {name: tables.read_table(files[name]) for name in files if name in known}
    there = [stage for stage in STAGES if (Path(folder) / f"model_{stage}.yaml").is_file()]
    models = {
        stage: load_plain_yaml((Path(folder) / f"model_{stage}.yaml").read_text(encoding="utf-8"))
        for stage in there
    }
    urdfs = {"declared": Path(urdf)} if urdf else {}
    urdfs |= {stage: Path(folder) / f"model_{stage}.urdf" for stage in there}
    links = {stage: _read_links(file.read_text(encoding="utf-8")) for stage, file in urdfs.items()}
    return ClosedLoop(verdict, models=models, links=links, **found)


def _read_links(urdf: str) -> dict[str, tuple[float, tuple[float, ...]]]:
    """Mass and centre of mass of each link that has them."""
    found = {}
    for link in ET.fromstring(urdf).iter("link"):
        mass, origin = link.find("inertial/mass"), link.find("inertial/origin")
        if mass is not None:
            place = "0 0 0" if origin is None else origin.get("xyz", "0 0 0")
            found[link.get("name", "")] = float(mass.get("value", "nan")), tuple(map(float, place.split()))
    return found


def number(value: Any) -> float:
    """A JSON number as a float; null is NaN."""
    return np.nan if value is None else float(value)


def bounded(value: float, interval: Sequence[Any] | None) -> str:
    """Text of a value with its interval, where there is one."""
    low, high = map(number, interval or (None, None))
    return interval_text(value, low, high)


def dominant_signals(loop: ClosedLoop, joint: str, most: int = 3) -> list[str]:
    """Signals to draw a joint's residual against, as ``<code>_<joint>`` or ``t``.

    First the signals of its names, then those that the unexplained residual depends on, then those of refuted
    names, then those along which the medians of the residual before the correction scatter most. A dependence
    on the direction of motion is drawn over the speed, as a step at 0.
    """
    entries = loop.entries_at(joint)
    stays, goes = ([one for one in entries if (one["status"] == "refuted") == gone] for gone in (False, True))
    left = loop.verdict["joints"][joint]
    wanted = [name for one in (*stays, left, *goes) for name in one["depends_on"]]
    if (table := loop.profiles) is not None:
        own = table[(table["joint"] == joint) & (table["stage"] == "before")]
        wanted += list(own.groupby("signal")["median"].std().sort_values(ascending=False).index)
    drawn = dict.fromkeys(name.replace("sign_qd_", "qd_", 1) for name in wanted)
    return [name for name in drawn if _split(loop, name)][:most]


def _split(loop: ClosedLoop, name: str) -> tuple[str, str] | None:
    """Code and joint in a signal's name; None where the tables lack the signal."""
    code, _, joint = name.partition("_")
    held = code in ("q", "qd", "qdd", "load", "temp") and joint in loop.joints
    return (code, joint) if name == "t" or held else None


def name_signal(name: str) -> str:
    """A signal of a verdict in words.

    >>> name_signal("qd_axis_2"), name_signal("sign_qd_axis_2"), name_signal("t")
    ('speed of axis_2', 'direction of axis_2', 'time')
    """
    code = next((code for code in _SIGNALS if name.startswith(f"{code}_")), "")
    if not code:
        return "time" if name == "t" else f"a {name}" if name == "constant" else name
    return f"{_SIGNALS[code][0]} of {name[len(code) + 1 :]}"


def label_signal(loop: ClosedLoop, signal: str) -> str:
    """Name and unit of a signal, for an axis."""
    if signal == "t":
        return "time since the start of the run [s]"
    code, _, joint = signal.partition("_")
    torque = loop.verdict["joints"][joint]["unit"]
    unit = _SIGNALS[code][1].format(position="m" if torque == "N" else "rad", torque=torque)
    return f"{name_signal(signal)} [{unit}]"


def against_signal(loop: ClosedLoop, joint: str, signal: str) -> pd.DataFrame:
    """Residuals of a joint at the rows that count, with the values `x` of a signal."""
    own = loop.residual[loop.residual["joint"] == joint].reset_index(drop=True)
    if signal == "t":
        own["x"] = own["t"] - own.groupby("run")["t"].transform("min")
    else:
        assert loop.signals is not None
        code, _, of = signal.partition("_")
        own["x"] = loop.signals.loc[loop.signals["joint"] == of, code].to_numpy()
    return own[own["counts"].astype(bool) & np.isfinite(own["x"])]


Event = Mapping[str, Any]


def join_events(events: Sequence[Event]) -> list[list[Event]]:
    """Groups of entries that overlap in time in a run, since several joints feel a push at the flange.

    >>> push = {"run": "r", "joint": "a", "t": 1.0, "seconds": 0.3, "size": 2.0}
    >>> [len(one) for one in join_events([push, push | {"joint": "b", "t": 1.2}, push | {"t": 4.0}])]
    [2, 1]
    """
    joined: list[list[Event]] = []
    for event in sorted(events, key=lambda one: (one["run"], one["t"])):
        last = joined[-1] if joined else []
        if last and last[0]["run"] == event["run"] and event["t"] <= _end(last):
            last.append(event)
        else:
            joined.append([event])
    return joined


def _end(event: Sequence[Event]) -> float:
    return float(max(one["t"] + one["seconds"] for one in event))


def render_event_table(events: Sequence[Event], units: Mapping[str, str]) -> Markup:
    """Table with a row for each event and the torque at each joint that feels it; `units` may be empty."""
    rows = [
        {"run": one[0]["run"], "starts at [s]": f"{one[0]['t']:.2f}"}
        | {"lasts [s]": f"{_end(one) - one[0]['t']:.2f}"}
        | {"torque that the model lacks": ", ".join(_tell_size(entry, units) for entry in one)}
        for one in join_events(events)
    ]
    return render_table(rows, filter_by={"run": "run"} if units else None)


def _tell_size(event: Event, units: Mapping[str, str]) -> str:
    return f"{event['joint']} {format_number(event['size'])} {units.get(event['joint'], '')}".rstrip()
