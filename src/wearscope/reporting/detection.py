"""Files of detectors on recordings, and their result in words."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.reporting.labels import count_text, detector_name, join_some, join_words, unit_text
from wearscope.reporting.page import format_number, read_outcome
from wearscope.reporting.page_strip import Strip
from wearscope.storage import tables

#: Words of factors by kind.
FACTOR_NAMES = {"wear": "wear", "temperature": "temperature", "payload_mass_error": "payload mass error"}
#: An alarm is told with the difference of temperature where that is larger than this [K].
WARMER = 1.0
#: Verdicts of a joint and detector in order; a recording takes the first of those that its joints have.
_ORDER = ("alarm", "unchecked", "no alarm", "withheld", "failed")
#: Wording of a threshold that was reached, by verdict.
_REACHED = {"alarm": "Alarm", "unchecked": "Above the threshold, but not confirmed,"}
_SURE = "Thresholds for {:g} % false alarms, from simulated runs that scatter as the machine."
_NONE = (
    "unsure",
    "No verdict: no threshold is shown to hold on this machine.",
    "Some detectors could not be fitted or have no threshold.",
)
#: Kind of a strip, how sure it is and its caveat, by the first verdict of all recordings.
_STRIPS = {
    "alarm": ("bad", _SURE, "A threshold holds along its own motion only."),
    "unchecked": (
        "unsure",
        "No alarm yet: simulated runs do not come so far, but how the machine scatters is unknown.",
        "Too few nominal sessions of this motion tell how the machine scatters; record three.",
    ),
    "no alarm": ("good", _SURE, ""),
    "withheld": _NONE,
    "failed": _NONE,
}
#: Kind of conclusion and wording for a recording, by its verdict.
_OUTCOMES = {"alarm": ("alarm", "alarm."), "no alarm": ("plain", "no alarm.")}
#: Verdicts that give no answer, and the reason.
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


def lead_verdicts(judged: pd.DataFrame) -> pd.Series:
    """Verdict of each judged recording: the first in `_ORDER` that a joint and detector of it has."""
    return judged.groupby("run", sort=False)["verdict"].agg(lambda own: min(own, key=_ORDER.index))


def detection_strip(found: Detections) -> Strip:
    """Whether any detector alarms on the recordings, and if none does, which wear would have shown."""
    judged, told = found.judged, found.summary["judged"]
    lead = lead_verdicts(judged)
    first, runs = min(lead, key=_ORDER.index), lead.value_counts()
    many, number = count_text(len(lead), "recording"), int(runs[first])
    scope = (
        f" Judged: {told['joints']} of {count_text(told['of'], 'joint')}, {told['seconds']:.0f} s recorded."
    )
    if found.summary["refused"]:
        scope += f" {count_text(len(found.summary['refused']), 'more recording')} refused."
    kind, sure, caveat = _STRIPS[first]
    if first in _REACHED:
        own = judged[judged["verdict"] == first]
        name = own["session"].where(own["session"] != "", own["run"]).astype(str)
        where = join_some([f"{one} at {_name_joints(joints)}" for one, joints in own.groupby(name)["joint"]])
        by = join_words(sorted(own["fda"].unique()))
        answer = f"{_REACHED[first]} in {number} of {many}: {where}, by {by}.{scope}"
    elif first == "no alarm":
        rest = f"; {len(lead) - number} could not be judged" if number < len(lead) else ""
        answer = f"No alarm in {count_text(number, 'recording')}{rest}.{scope}"
        caveat, kind = _tell_unseen(found.thresholds), "unsure" if rest else kind
    else:
        answer = f"None of {many} could be judged."
    if "withheld" in runs:
        caveat = f"Withheld in {count_text(runs['withheld'], 'recording')}: some detectors have no threshold."
    action = Markup('See <a href="#values">every value</a>; <code>wearscope track</code> says what changed.')
    return Strip(answer, kind, sure.format(100 * found.summary["setting"]["p_f"]), caveat, action)


def _name_joints(joints: pd.Series) -> str:
    """Names of up to two joints, else their number."""
    names = sorted(joints.astype(str).unique())
    return join_words(names) if len(names) <= 2 else count_text(len(names), "joint")


def _tell_unseen(thresholds: pd.DataFrame) -> str:
    """The smallest wear that would have raised an alarm, by the detector that sees it first at each joint."""
    least = thresholds.groupby(["motion", "joint"])["wear_detected"].min()
    blind = sorted({joint for _, joint in least.index[least.isna()]})
    told = f"Wear below {format_number(float(least.max()), 2)} may raise none"
    if blind:
        told = f"Which wear would raise one at {join_words(blind)} is unknown"
    return f"{told}; wearscope track states the smallest change that it sees."


def write_quantity(row: Mapping[Any, Any], name: str = "y") -> str:
    """Test quantity, or its threshold, with its unit."""
    return f"{format_number(float(row[name]))} {unit_text(row['unit'])}".strip()


def conclude(found: Detections) -> list[tuple[str, str]]:
    """Conclusions, alarms first: kind (``alarm``, ``notice``, ``plain``) and sentence.

    Recordings with the same outcome share a sentence.
    """
    said: dict[tuple[str, str], list[str]] = {}
    lead = lead_verdicts(found.judged)
    for run, rows in found.judged.groupby("run", sort=False):
        session = rows["session"].iloc[0]
        name = f"{run} ({session})" if session else str(run)
        kind, outcome = _OUTCOMES.get(lead[run], ("notice", "not decided."))
        if kind == "alarm":
            alarms = rows[rows["verdict"] == "alarm"]
            outcome += f" {_tell_alarms(alarms)}.{_tell_warmth(alarms)}"
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
    """Scatter of the machine compared with the simulator's, in words."""
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
