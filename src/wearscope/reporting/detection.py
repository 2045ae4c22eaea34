"""Files of detectors on recordings, and their result in words."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.reporting.labels import count_text, detector_name, join_some, join_words, unit_text
from wearscope.reporting.page import format_number, read_outcome, say
from wearscope.reporting.page_strip import Strip
from wearscope.storage import tables

#: Words of factors by kind.
FACTOR_NAMES = {"wear": "wear", "temperature": "temperature", "payload_mass_error": "payload mass error"}
#: An alarm is told with the difference of temperature where that is larger than this [K].
WARMER = 1.0
#: Verdicts of a joint and detector in order; a recording takes the first of those that its joints have.
_ORDER = ("alarm", "unchecked", "no alarm", "withheld", "failed")
_WORDS = "detection/words.html"
#: Colour of what is said first; any other verdict is unsure.
_KINDS = {"alarm": "bad", "no alarm": "good"}
#: Kind of conclusion on a recording by its verdict; any other verdict is a notice.
_SAID = {"alarm": "alarm", "no alarm": "plain"}
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
    told = describe(found)
    kind = (
        "unsure" if told.first == "no alarm" and told.number < told.all else _KINDS.get(told.first, "unsure")
    )
    answer, sure, caveat = (say(_WORDS, part, told).striptags() for part in ("answer", "sure", "caveat"))
    action = Markup('See <a href="#values">every value</a>; <code>wearscope track</code> says what changed.')
    return Strip(answer, kind, sure, caveat, action)


def describe(found: Detections) -> SimpleNamespace:
    """What the words of the strip need of all recordings."""
    lead = lead_verdicts(found.judged)
    first, runs = min(lead, key=_ORDER.index), lead.value_counts()
    own = found.judged[(found.judged["verdict"] == first) & (first in ("alarm", "unchecked"))]
    name = own["session"].where(own["session"] != "", own["run"]).astype(str)
    least = found.thresholds.groupby(["motion", "joint"])["wear_detected"].min()
    return SimpleNamespace(
        first=first,
        number=int(runs[first]),
        all=len(lead),
        where=join_some([f"{one} at {_name_joints(joints)}" for one, joints in own.groupby(name)["joint"]]),
        by=join_words(sorted(own["fda"].unique())),
        joints=found.summary["judged"]["joints"],
        of=found.summary["judged"]["of"],
        seconds=f"{found.summary['judged']['seconds']:.0f}",
        refused=len(found.summary["refused"]),
        false=f"{100 * found.summary['setting']['p_f']:g}",
        withheld=int(runs.get("withheld", 0)),
        blind=join_words(sorted({joint for _, joint in least.index[least.isna()]})),
        unseen=format_number(float(least.max()), 2),
    )


def _name_joints(joints: pd.Series) -> str:
    """Names of up to two joints, else their number."""
    names = sorted(joints.astype(str).unique())
    return join_words(names) if len(names) <= 2 else count_text(len(names), "joint")


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
        session, kind = rows["session"].iloc[0], _SAID.get(lead[run], "notice")
        text = say(_WORDS, "outcome", kind, *_describe_outcome(rows)).striptags()
        said.setdefault((kind, text), []).append(f"{run} ({session})" if session else str(run))
    sentences = [(kind, f"{join_words(names)}: {text}") for (kind, text), names in said.items()]
    return sorted(sentences, key=lambda one: ("alarm", "notice", "plain").index(one[0]))


def _describe_outcome(rows: pd.DataFrame) -> tuple[list[Any], list[str], list[Any]]:
    """Of a recording: places of its alarms by detector, joints that were warmer there, what is left open."""
    alarms = rows[rows["verdict"] == "alarm"]
    places = [
        (fda, [f"{row.joint}{_tell_like(row.wear)}" for row in own.itertuples()])
        for fda, own in alarms.groupby("fda", sort=True)
    ]
    warmer = [
        f"{row.joint} was {format_number(abs(row.warmer), 2)} K {'warmer' if row.warmer > 0 else 'colder'}"
        for row in alarms.drop_duplicates("joint").itertuples()
        if abs(row.warmer) > WARMER
    ]
    left = [(text, rows[rows["verdict"] == verdict]) for verdict, text in _OPEN.items()]
    unknown = [
        (text, [(fda, sorted(part["joint"])) for fda, part in own.groupby("fda", sort=True)])
        for text, own in left
    ]
    return places, warmer, unknown


def _tell_like(wear: float) -> str:
    """Simulated wear that gives such a value; empty where it is not known."""
    return f" (as at wear {format_number(float(wear), 2)})" if np.isfinite(wear) else ""


def tell_scatter(found: Detections) -> list[Markup]:
    """Scatter of the machine compared with the simulator's, in words."""
    table = found.thresholds[found.thresholds["reason"] == ""]
    known = table[np.isfinite(table["widening"].astype(float))]
    wide = known[known["scatter_ratio"] > 1.0].sort_values("scatter_ratio")
    most = [
        (one.joint, one.fda, format_number(one.scatter_ratio, 2)) for one in wide.tail(1).itertuples()
    ] or [("", "", "")]
    said = [
        say(_WORDS, "scatter", len(wide), len(known), *most[0]),
        say(_WORDS, "unknown", len(table) - len(known)),
    ]
    return list(filter(None, said))


def tell_factors(found: Detections) -> list[Markup]:
    """Which factors move nothing in the simulated runs."""
    return [
        say(
            _WORDS,
            "idle",
            found.summary["model"],
            motion,
            join_words([FACTOR_NAMES[one] for one in idle]),
            len(idle),
        )
        for motion, one in found.summary["motions"].items()
        if (idle := one["factors_that_move_nothing"])
    ]
