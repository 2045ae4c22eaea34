"""What closing the loop left in its folder, as a page asks for it."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope import tables
from wearscope.errors import InputError
from wearscope.reporting.page import interval_text

STAGES = ("before", "after")
_OPTIONAL = ("signals", "profiles", "forward", "forward_series")


@dataclass(frozen=True)
class ClosedLoop:
    """One closed loop's outcome: ``verdict.json`` and its tables, None where it was closed without one."""

    verdict: Mapping[str, Any]
    residual: pd.DataFrame
    candidates: pd.DataFrame
    signals: pd.DataFrame | None = None
    profiles: pd.DataFrame | None = None
    forward: pd.DataFrame | None = None
    forward_series: pd.DataFrame | None = None

    @property
    def joints(self) -> list[str]:
        """Joint names, in the data set's order."""
        return list(self.verdict["joints"])

    def entries_at(self, joint: str) -> list[Mapping[str, Any]]:
        """Entries of the verdict at a joint."""
        return [entry for entry in self.verdict["verdict"] if entry["joint"] == joint]

    def shown(self, most: int = 3) -> list[str]:
        """Joints worth a figure: refuted, unexplained, named, in this order; else the largest error."""

        def rank(joint: str) -> int:
            entries = self.entries_at(joint)
            if any(entry["status"] == "refuted" for entry in entries):
                return 0
            if self.verdict["joints"][joint]["state"] == "unexplained":
                return 1
            return 2 if entries else 3

        ranked = sorted(self.joints, key=rank)
        chosen = [joint for joint in ranked if rank(joint) < 3][:most]
        return chosen or [max(self.joints, key=self._relative_error)]

    def foremost(self) -> str:
        """The joint shown first: one whose model was corrected, else as `shown` has them."""
        named = [entry["joint"] for entry in self.verdict["verdict"] if entry["status"] == "confirmed"]
        return str(named[0]) if named else self.shown()[0]

    def _relative_error(self, joint: str) -> float:
        values = self.verdict["joints"][joint].get("relative_error_percent", {}).values()
        known = [before for before, _ in values if before is not None]
        return max(known, default=-1.0)


def read_closed_loop(folder: str | Path) -> ClosedLoop:
    """Read a closed loop's files.

    Raises
    ------
    InputError
        Where ``verdict.json``, ``residual.parquet`` or ``candidates.parquet`` is missing or damaged.
    """
    place = Path(folder)
    try:
        verdict = json.loads((place / "verdict.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            f"{place / 'verdict.json'}: cannot be read ({error}); close the loop first."
        ) from error
    found = {
        name: tables.read_table(place / f"{name}.parquet")
        for name in _OPTIONAL
        if (place / f"{name}.parquet").exists()
    }
    return ClosedLoop(
        verdict,
        tables.read_table(place / "residual.parquet"),
        tables.read_table(place / "candidates.parquet"),
        **found,
    )


def number(value: Any) -> float:
    """A JSON number; what is null is not a number."""
    return np.nan if value is None else float(value)


def bounded(value: float, interval: Sequence[Any] | None) -> str:
    """A value with its interval, where there is one."""
    low, high = interval or (None, None)
    return interval_text(value, number(low), number(high))


def dominant_signals(loop: ClosedLoop, joint: str, most: int = 3) -> list[str]:
    """Signals to draw a joint's residual against, as ``<code>_<joint>`` or ``t``.

    Those that its verdict names, those that what is left unexplained depends on, then those along which the
    medians of the residual before scatter most. The direction of motion is drawn as the speed, where it is a
    step.
    """
    wanted = [name for entry in loop.entries_at(joint) for name in entry["depends_on"]]
    wanted += loop.verdict["joints"][joint]["depends_on"]
    if loop.profiles is not None:
        table = loop.profiles
        own = table[(table["joint"] == joint) & (table["stage"] == "before")]
        wanted += list(own.groupby("signal")["median"].std().sort_values(ascending=False).index)
    chosen: list[str] = []
    for name in wanted:
        known = name.replace("sign_qd_", "qd_", 1)
        if known not in chosen and split_signal(known, loop.joints) is not None:
            chosen.append(known)
    return chosen[:most]


def split_signal(name: str, joints: Sequence[str]) -> tuple[str, str] | None:
    """Column and joint of a signal's name, or None where the tables do not hold it."""
    if name == "t":
        return "t", ""
    code, _, joint = name.partition("_")
    return (code, joint) if code in ("q", "qd", "qdd", "load", "temp") and joint in joints else None


_SIGNAL_NAMES = {
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


def name_signal(name: str) -> str:
    """A signal of a verdict in words.

    >>> name_signal("qd_axis_2"), name_signal("sign_qd_axis_2"), name_signal("t")
    ('speed of axis_2', 'direction of axis_2', 'time')
    """
    code = next((code for code in _SIGNAL_NAMES if name.startswith(f"{code}_")), "")
    if not code:
        return "time" if name == "t" else f"a {name}" if name == "constant" else name
    return f"{_SIGNAL_NAMES[code][0]} of {name[len(code) + 1 :]}"


def signal_label(loop: ClosedLoop, signal: str) -> str:
    """Name and unit of a signal, for an axis."""
    if signal == "t":
        return "time since the start of the run [s]"
    place = split_signal(signal, loop.joints)
    assert place is not None
    torque = loop.verdict["joints"][place[1]]["unit"]
    word, unit = _SIGNAL_NAMES[place[0]]
    return f"{word} of {place[1]} [{unit.format(position='m' if torque == 'N' else 'rad', torque=torque)}]"


def against_signal(loop: ClosedLoop, joint: str, signal: str) -> pd.DataFrame:
    """Residuals of a joint at the rows that count, with the values `x` of a signal."""
    own = loop.residual[loop.residual["joint"] == joint].reset_index(drop=True)
    place = split_signal(signal, loop.joints)
    assert place is not None
    if place[0] == "t":
        own["x"] = own["t"] - own.groupby("run")["t"].transform("min")
    else:
        assert loop.signals is not None
        of = loop.signals[loop.signals["joint"] == place[1]].reset_index(drop=True)
        own["x"] = of[place[0]].to_numpy()
    return own[own["counts"].astype(bool) & np.isfinite(own["x"])]
