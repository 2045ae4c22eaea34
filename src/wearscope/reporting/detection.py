"""What detectors on recordings left in their folder, and what that says in words."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.reporting.labels import count_text, detector_name, join_words, unit_text
from wearscope.reporting.page import format_number, read_outcome
from wearscope.reporting.page_strip import Strip
from wearscope.storage import tables

#: Words of factors by kind.
FACTOR_NAMES = {"wear": "wear", "temperature": "temperature", "payload_mass_error": "payload mass error"}
#: Difference of temperatures that an alarm is said with [K].
WARMER = 1.0
#: Verdicts that are no answer, and why.
_OPEN = {
    "withheld": "No threshold",
    "unchecked": "Above the threshold, but too few nominal sessions tell how the machine scatters",
}


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
    """Read the files of target ``detect``, with the detectors' full names.

    Raises
    ------
    InputError
        Where they are not there.
    """
    summary = read_outcome(Path(folder) / "detection.json", "run the target detect first")
    full = {code: detector_name(code, use) for code, use in summary.get("detectors", {}).items()}
    names = ("detection", "thresholds", "simulated")
    read = (tables.read_table(Path(folder) / f"{name}.parquet") for name in names)
    return Detections(summary, *(one.assign(fda=one["fda"].astype(str).replace(full)) for one in read))


def detection_strip(found: Detections) -> Strip:
    """Whether any detector alarms on the recordings."""
    judged = found.judged
    runs = judged.groupby("verdict")["run"].nunique()
    alarms, withheld = int(runs.get("alarm", 0)), int(runs.get("withheld", 0))
    decided = int(judged.loc[judged["verdict"].isin(["alarm", "no alarm"]), "run"].nunique())
    count = int(judged["run"].nunique())
    many = count_text(count, "recording")
    answer = f"No alarm in {count_text(decided, 'recording')}"
    answer += "." if decided == count else f"; {count - decided} could not be judged."
    told, refused = found.summary["judged"], len(found.summary["refused"])
    scope = f" Judged at {told['joints']} of {count_text(told['of'], 'joint')}, for {told['seconds']:.0f} s."
    if refused:
        scope += f" {count_text(refused, 'more recording')} refused."
    answer += scope
    if not decided:
        answer = f"None of {many} could be judged."
    if alarms:
        own = judged[judged["verdict"] == "alarm"]
        where = join_words(sorted(own["joint"].astype(str).unique()))
        by = join_words(sorted(own["fda"].unique()))
        answer = f"Alarm in {alarms} of {many}, at {where}, by {by}.{scope}"
    rate = found.summary["setting"]["p_f"]
    sure = f"Thresholds for {100 * rate:g} % false alarms, from simulated runs that scatter as the machine."
    if not decided:
        sure = "No verdict: no threshold is shown to hold on this machine."
    caveat, kind = "A threshold holds along its own motion only.", "good"
    if decided < count:
        caveat, kind = "Some detectors could not be fitted or have no threshold.", "unsure"
    if withheld or runs.get("unchecked"):
        caveat, kind = "Too few nominal sessions tell how the machine scatters; record three.", "unsure"
    if withheld:
        caveat = f"Withheld in {count_text(withheld, 'recording')}: some detectors have no threshold."
    action = Markup('See <a href="#values">every value</a>; <code>wearscope track</code> says what changed.')
    return Strip(answer, "bad" if alarms else kind, sure, caveat, action)


def write_quantity(row: Mapping[Any, Any], name: str = "y") -> str:
    """Test quantity, or its threshold, with its unit."""
    return f"{format_number(float(row[name]))} {unit_text(row['unit'])}".strip()


def conclude(found: Detections) -> list[tuple[str, str]]:
    """Conclusions, alarms first: kind (``alarm``, ``notice``, ``plain``) and sentence.

    Recordings of which the same is said share a sentence.
    """
    said: dict[tuple[str, str], list[str]] = {}
    for run, rows in found.judged.groupby("run", sort=False):
        session = rows["session"].iloc[0]
        name = f"{run} ({session})" if session else str(run)
        alarms = rows[rows["verdict"] == "alarm"]
        kind, outcome = "notice", "not decided."
        if len(alarms):
            kind, outcome = "alarm", f"alarm. {_tell_alarms(alarms)}.{_tell_warmth(alarms)}"
        elif (rows["verdict"] == "no alarm").any():
            kind, outcome = "plain", "no alarm."
        said.setdefault((kind, f"{outcome}{_tell_rest(rows)}"), []).append(name)
    sentences = [(kind, f"{join_words(names)}: {text}") for (kind, text), names in said.items()]
    return sorted(sentences, key=lambda one: ("alarm", "notice", "plain").index(one[0]))


def _tell_alarms(alarms: pd.DataFrame) -> str:
    """Which detectors alarm at which joints, and the wear that gives such values where it is simulated."""
    told = []
    for fda, rows in alarms.groupby("fda", sort=True):
        likes = [
            f" (as at wear {format_number(float(one), 2)})" * bool(np.isfinite(one)) for one in rows["wear"]
        ]
        places = [f"{joint}{like}" for joint, like in zip(rows["joint"], likes, strict=True)]
        told.append(f"{fda} at {join_words(places)}")
    return "; ".join(told)


def _tell_warmth(alarms: pd.DataFrame) -> str:
    """How much warmer or colder the joints with an alarm were, where it is more than a kelvin."""
    away = alarms.drop_duplicates("joint")
    parts = [
        f"{joint} was {format_number(abs(warmer), 2)} K {'warmer' if warmer > 0 else 'colder'}"
        for joint, warmer in zip(away["joint"], away["warmer"], strict=True)
        if abs(warmer) > WARMER
    ]
    told = f" {join_words(parts)} than in the nominal recordings, which may be the reason."
    return told if parts else ""


def _tell_rest(rows: pd.DataFrame) -> str:
    parts = []
    for verdict, text in _OPEN.items():
        own = rows[rows["verdict"] == verdict].groupby("fda", sort=True)
        where = [f"{fda} at {join_words(sorted(part['joint']))}" for fda, part in own]
        parts += [f" {text}: {'; '.join(where)}."] if where else []
    return "".join(parts)


def tell_scatter(found: Detections) -> list[str]:
    """How the machine scatters next to the simulator, in words."""
    table = found.thresholds[found.thresholds["reason"] == ""]
    known = table[np.isfinite(table["widening"].astype(float))]
    wide, cells = known[known["scatter_ratio"] > 1.0], count_text(len(known), "cell")
    sentences = []
    if len(wide):
        worst = wide.sort_values("scatter_ratio").iloc[-1]
        sentences.append(
            f"In {len(wide)} of {cells} (motion, joint and detector) nominal recordings scatter more than "
            f"the simulated runs, most at {worst['joint']} with {worst['fda']}: "
            f"{format_number(worst['scatter_ratio'], 2)} times. The thresholds are widened by that."
        )
    elif len(known):
        sentences.append(f"In no cell of {len(known)} do the nominal recordings scatter more than simulated.")
    if len(known) < len(table):
        sentences.append(
            f"In {count_text(len(table) - len(known), 'cell')} there are fewer than 3 nominal sessions: how "
            "the machine scatters is not known. Record the motion again, healthy."
        )
    return sentences


def tell_factors(found: Detections) -> list[str]:
    """Which factors move nothing in the simulated runs."""
    sentences, model = [], found.summary["model"]
    for motion, one in found.summary["motions"].items():
        idle = [FACTOR_NAMES[kind] for kind in one["factors_that_move_nothing"]]
        if idle:
            verb = "moves" if len(idle) == 1 else "move"
            sentences.append(f"In the model {model}, {join_words(idle)} {verb} no torque of {motion}.")
        if "wear" in idle:
            sentences.append("The model has no wear, so a test quantity is not told as wear.")
    return sentences
