"""Scores what tracking says of a machine's sessions against what was done to it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.board.session_cases import SessionCase
from benchmarks.summary import tell_share

FRICTION = ("coulomb", "viscous", "wear")
"""Names of a change of friction."""
PROMPT = 2
"""Sessions within which a step must be found."""


def score_sessions(
    case: SessionCase, truth: Mapping[str, Any], told: Mapping[str, Any], changes: pd.DataFrame
) -> list[dict[str, Any]]:
    """A row a later session.

    Parameters
    ----------
    case : SessionCase
    truth : mapping
        As `benchmarks.board.session_folder.write_sessions` returns it.
    told : mapping
        The content of ``tracking.json``.
    changes : DataFrame
        ``changes.parquet``.

    Returns
    -------
    list of dict
        `changed` (what was done: wear, load, drive or nothing), `since_onset` (sessions since the first
        change), `entries`, `false` (an entry that nothing done explains), `friction` (friction of any joint
        is named that was not worn), `found`, `only` (and nothing else), `since_right`, `covered` (the planted
        size lies in its interval), `cannot_tell`.
    """
    rows: list[dict[str, Any]] = []
    told_of = {one["session"]: one for one in told["sessions"]}
    onset: dict[str, int] = {}
    before = ""
    for k, planted in enumerate(truth["sessions"]):
        one = told_of[planted["session"]]
        kind = _what(planted)
        if kind != before:
            onset[kind] = k
        before = kind
        mine = [entry for entry in one["changes"] if _explains(case, truth, planted, entry)]
        wrong = [entry for entry in one["changes"] if entry not in mine]
        found = [entry for entry in mine if _is_named(planted, entry)]
        first = truth["sessions"][onset[kind]]["session"]
        rows.append(
            {
                "case": case.number, "kind": case.kind, "thermometer": case.thermometer, "form": case.form,
                "machine": case.machine.name, "joints": len(case.machine.joints), "scatter": case.scatter,
                "noise_level": case.recipe.noise_level, "noise": case.recipe.noise,
                "session": planted["session"], "changed": kind, "since_onset": k - onset[kind],
                "wear": planted["wear"], "entries": len(one["changes"]),
                "said": "; ".join(map(_tell, one["changes"])),
                "false": bool(wrong),
                "friction": any(e["effect"] in FRICTION for e in wrong),
                "found": bool(found) if kind != "nothing" else None,
                "only": bool(found) and not wrong if kind != "nothing" else None,
                "since_right": all(e["since"] == first for e in found) if found else None,
                "covered": _is_covered(case, truth, planted, found, changes) if found else None,
                "cannot_tell": len(one["cannot_tell"]),
            }
        )  # fmt: skip
    return rows


def _tell(entry: Mapping[str, Any]) -> str:
    return f"{entry['effect']}@{entry['joint']}" + (f"{entry['equivalent']}" if entry["equivalent"] else "")


def _what(planted: Mapping[str, Any]) -> str:
    return (
        "wear"
        if planted["wear"]
        else "load"
        if planted["load"]
        else "drive"
        if planted["gain"]
        else "nothing"
    )


def _explains(
    case: SessionCase, truth: Mapping[str, Any], planted: Mapping[str, Any], entry: Mapping[str, Any]
) -> bool:
    """Whether what was done explains an entry: its name, or one that the entry itself calls equivalent."""
    said = {entry["effect"], *entry["equivalent"]}
    if planted["wear"]:
        return entry["joint"] == truth["joint"] and entry["effect"] in FRICTION
    if planted["load"]:
        return "payload_error" in said
    if planted["gain"]:
        return entry["joint"] == truth["joint"] and "torque_constant_error" in said
    return False


def _is_named(planted: Mapping[str, Any], entry: Mapping[str, Any]) -> bool:
    """Whether an entry that is explained says it by name."""
    if planted["load"]:
        return entry["effect"] == "payload_error"
    return True


def _is_covered(
    case: SessionCase, truth: Mapping[str, Any], planted: Mapping[str, Any], found: list[Any],
    changes: pd.DataFrame,
) -> bool | None:  # fmt: skip
    """Whether the planted size lies in its 95 % interval; None where nothing said is the same quantity."""
    if planted["wear"]:
        own = changes[
            (changes["session"] == planted["session"])
            & (changes["joint"] == truth["joint"])
            & (changes["effect"] == "friction")
        ]
        if not len(own):
            return None
        return bool(own["change_low"].iloc[0] <= planted["torque"] <= own["change_high"].iloc[0])
    name, size = ("mass", truth["mass"]) if planted["load"] else ("gain", planted["gain"])
    stated = [entry for entry in found if entry["parameter"] == name]
    if not stated:
        return None
    low, high = stated[0]["ci95"]
    return bool(low <= size <= high)


def summarise_sessions(rows: pd.DataFrame) -> pd.DataFrame:
    """Shares with Clopper-Pearson 95 % intervals.

    Parameters
    ----------
    rows : DataFrame
        Of `score_sessions`, all cases.
    """
    kind, changed = rows["kind"], rows["changed"]
    quiet, worn, load, drive = (changed == what for what in ("nothing", "wear", "load", "drive"))
    step, warmer, against = (
        worn & (kind == name) for name in ("wear_step", "swing_with_wear", "swing_against_wear")
    )
    found = rows["found"].eq(True)

    def within_two(pick: "pd.Series[bool]") -> "pd.Series[Any]":
        own = rows[pick & (rows["since_onset"] < PROMPT)].groupby("case")
        return own["found"].max().astype(bool) & ~own["false"].max().astype(bool)

    prompt = "found in the first two sessions, named friction or wear and nothing else"
    questions = {
        "nothing changed: false alarms, sessions": rows.loc[quiet, "false"],
        "20 K swings, nothing changed: friction named, sessions":
            rows.loc[quiet & kind.str.startswith("swing"), "friction"],
        "something changed: an entry that it does not explain, sessions": rows.loc[~quiet, "false"],
        f"wear step of a tenth: {prompt}": within_two(step),
        f"wear of a fifth while it grows colder by 20 K: {prompt}": within_two(warmer),
        f"wear of a fifth while it grows warmer by 20 K: {prompt}": within_two(against),
        "wear step of a tenth: found, sessions": rows.loc[step, "found"],
        "wear: right first session, where found": rows.loc[(step | warmer | against) & found, "since_right"],
        "wear: RMS torque in its interval, where found": rows.loc[worn & found, "covered"],
        "load: named, sessions": rows.loc[load, "found"],
        "load: right first session, where named": rows.loc[load & found, "since_right"],
        "load: mass in its interval, where named": rows.loc[load & found, "covered"],
        "drive: named or equivalent, sessions": rows.loc[drive, "found"],
        "drive: right first session, where named": rows.loc[drive & found, "since_right"],
        "drive: gain in its interval, where stated": rows.loc[drive & found, "covered"],
    }  # fmt: skip
    table = []
    for question, answers in questions.items():
        told = tell_share(answers)
        share = np.nan if told["share"] is None else told["share"]
        low, high = told["ci95"]
        table.append({"question": question, "count": told["hits"], "n": told["cases"], "share": share,
                      "low": low, "high": high})  # fmt: skip
    return pd.DataFrame(table)
