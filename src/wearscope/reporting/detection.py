"""What detectors on recordings left in their folder, and what that says in words."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope import tables
from wearscope.errors import InputError
from wearscope.reporting.labels import count_text, join_words, unit_text
from wearscope.reporting.page import format_number

#: Words of factors by kind.
FACTOR_NAMES = {"wear": "wear", "temperature": "temperature", "payload_mass_error": "payload mass error"}


#: Difference of temperatures that an alarm is said with [K].
WARMER = 1.0


@dataclass(frozen=True)
class Detections:
    """Outcome of target ``detect``: ``detection.json`` and the tables next to it."""

    summary: Mapping[str, Any]
    detection: pd.DataFrame
    thresholds: pd.DataFrame
    simulated: pd.DataFrame

    @property
    def judged(self) -> pd.DataFrame:
        """Rows of the judged recordings."""
        return self.detection[self.detection["kind"] == "judged"]


def read_detections(folder: str | Path) -> Detections:
    """Read the files of target ``detect``.

    Raises
    ------
    InputError
        Where they are not there.
    """
    path = Path(folder) / "detection.json"
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read; run the target detect first.") from error
    names = ("detection", "thresholds", "simulated")
    return Detections(summary, *(tables.read_table(Path(folder) / f"{name}.parquet") for name in names))


def write_quantity(value: float, unit: str) -> str:
    """Test quantity with its unit."""
    return f"{format_number(float(value))} {unit_text(unit)}".strip()


def conclude(found: Detections) -> list[tuple[str, str]]:
    """Conclusions as kind (``alarm``, ``notice``, ``plain``) and sentence, one a recording, alarms first."""
    said = []
    for run, rows in found.judged.groupby("run", sort=False):
        session = rows["session"].iloc[0]
        name = f"{run} ({session})" if session else str(run)
        alarms = rows[rows["verdict"] == "alarm"]
        if len(alarms):
            told = "; ".join(_tell_alarm(row) for row in alarms.to_dict("records"))
            said.append(("alarm", f"{name}: alarm. {told}.{_tell_warmth(alarms)}{_tell_rest(rows)}"))
        elif (rows["verdict"] == "no alarm").any():
            said.append(("plain", f"{name}: no alarm.{_tell_rest(rows)}"))
        else:
            said.append(("notice", f"{name}: not decided.{_tell_rest(rows)}"))
    return sorted(said, key=lambda one: ("alarm", "notice", "plain").index(one[0]))


def _tell_alarm(row: Mapping[str, Any]) -> str:
    text = (
        f"{row['fda']} at {row['joint']}: {write_quantity(row['y'], row['unit'])}, threshold "
        f"{write_quantity(row['threshold'], row['unit'])}"
    )
    return text + tell_wear(row)


def _tell_warmth(alarms: pd.DataFrame) -> str:
    """How much warmer or colder the joints with an alarm were, where it is more than a kelvin."""
    away = alarms.drop_duplicates("joint")
    away = away[away["warmer"].abs() > WARMER]
    parts = [
        f"{row['joint']} {format_number(abs(row['warmer']), 2)} K "
        f"{'warmer' if row['warmer'] > 0 else 'colder'}"
        for row in away.to_dict("records")
    ]
    return f" Than in the nominal recordings {join_words(parts)}: it may be that." if parts else ""


def tell_wear(row: Mapping[str, Any]) -> str:
    """``, as simulated at wear 12 (95 %: 8 to 17)``; empty where no wear is known."""
    if not np.isfinite(row["wear"]):
        return ""
    low, middle, high = (format_number(float(row[name]), 2) for name in ("wear_low", "wear", "wear_high"))
    return f", as simulated at wear {middle} (95 %: {low} to {high})"


def _tell_rest(rows: pd.DataFrame) -> str:
    parts = []
    for verdict, text in (
        ("withheld", "Withheld, as the simulator's scatter is not the machine's or there is no threshold"),
        ("unchecked", "Above the threshold, but too few nominal recordings check it"),
    ):
        own = rows[rows["verdict"] == verdict]
        if len(own):
            where = [
                f"{fda} at {join_words(sorted(part['joint']))}" for fda, part in own.groupby("fda", sort=True)
            ]
            parts.append(f" {text}: {'; '.join(where)}.")
    return "".join(parts)


def tell_scatter(found: Detections) -> list[str]:
    """Whether the simulator's scatter is the machine's, in words."""
    table = found.thresholds[found.thresholds["reason"] == ""]
    unlike = table[table["scatter"] == "not the machine's"]
    alike, unknown = (table["scatter"] == "the machine's").sum(), (table["scatter"] == "not known").sum()
    sentences = []
    if len(unlike):
        worst = unlike.sort_values("scatter_ratio").iloc[-1]
        cells = len(table) - int(unknown)
        sentences.append(
            f"In {len(unlike)} of {count_text(cells, 'cell')} (motion, joint and detector) the nominal "
            f"recordings do not lie where the simulated runs do, most at {worst['joint']} with "
            f"{worst['fda']}: {format_number(worst['scatter_ratio'], 2)} times as far from the simulated "
            "median. There the threshold's false-alarm rate is not the machine's, and no alarm is given."
        )
    if alike:
        sentences.append(
            f"In {count_text(int(alike), 'cell')} (motion, joint and detector) the nominal recordings lie "
            "where the simulated runs do."
        )
    if unknown:
        sentences.append(
            f"In {count_text(int(unknown), 'cell')} there are fewer than 3 nominal recordings: whether the "
            "threshold holds on the machine is not known. Record the motion again, healthy."
        )
    return sentences


def tell_factors(found: Detections) -> list[str]:
    """What scatters in the simulated runs, and which factors move nothing."""
    sentences = []
    for motion, one in found.summary["motions"].items():
        idle = [FACTOR_NAMES[kind] for kind in one["factors_that_move_nothing"]]
        if idle:
            sentences.append(
                f"In the model {found.summary['model']}, {join_words(idle)} move{'s' * (len(idle) == 1)} no "
                f"torque of {motion}."
            )
        if "wear" in one["factors_that_move_nothing"]:
            sentences.append("So no wear is given with a test quantity: the model has no effect wear.")
    return sentences
