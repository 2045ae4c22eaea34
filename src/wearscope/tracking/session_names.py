"""Sessions of a data set: their names, which were healthy, and in which order they were recorded.

Only ``dataset.yaml`` is read here: the workflow asks for the names whenever it starts.
"""

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from wearscope.closed_loop.intake.dataset_fields import read_fields
from wearscope.closed_loop.intake.field_checks import check_fields
from wearscope.errors import InputError


@dataclass(frozen=True)
class Sessions:
    """Sessions of a data set in the order of their recording.

    Attributes
    ----------
    folder : Path
    name : str
    reference : tuple of str
        Sessions in which the machine was healthy.
    later : tuple of str
        All others.
    order : tuple of str
        All sessions in the order of their recording.
    notes : tuple of str
    """

    folder: Path
    name: str
    reference: tuple[str, ...]
    later: tuple[str, ...]
    order: tuple[str, ...]
    notes: tuple[str, ...] = ()


def read_moment(session: str) -> datetime | None:
    """Date and time of a session's ISO 8601 label; None for any other label."""
    try:
        moment = datetime.fromisoformat(session)
    except ValueError:
        return None
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)


def sort_sessions(sessions: Sequence[str]) -> list[str]:
    """Sessions by date where every label is a date, else in the order given."""
    moments = {session: read_moment(session) for session in sessions}
    known = {session: moment for session, moment in moments.items() if moment is not None}
    return sorted(sessions, key=known.__getitem__) if len(known) == len(moments) else list(sessions)


def read_sessions(dataset: str | Path) -> Sessions:
    """Sessions that a data set's ``dataset.yaml`` states; no recording is read.

    Raises
    ------
    InputError
        Where there is no reference, no later session, or no training run in the reference.
    """
    path = Path(dataset)
    path = path if path.suffix in (".yaml", ".yml") else path / "dataset.yaml"
    fields = read_fields(path, [])
    check_fields(path, fields)
    stated = list(dict.fromkeys(run.session for run in fields.runs if run.session is not None))
    order = sort_sessions(stated)
    if not fields.reference:
        first = f", e.g. 'reference: [\"{order[0]}\"]'" if order else ""
        told = "" if order else " No run has a session yet: state one for each ('session: monday')."
        raise InputError(
            f"{path}: reference is missing; list the sessions in which the machine was healthy{first}.{told}"
        )
    reference = [session for session in order if session in fields.reference]
    later = [session for session in order if session not in fields.reference]
    if not any(run.use == "train" and run.session in reference for run in fields.runs):
        raise InputError(
            f"{path}: no run of the reference has 'use: train'; the healthy machine is identified from such "
            "runs, mark at least one."
        )
    if not later:
        raise InputError(
            f"{path}: every session is in the reference; add a run of a later session, or take one out of it."
        )
    without = [run.file for run in fields.runs if run.session is None]
    notes = tuple(f"{file}: has no session and was not used." for file in without)
    return Sessions(path.parent, fields.name, tuple(reference), tuple(later), tuple(order), notes)


@dataclass(frozen=True)
class Tracked:
    """Sessions as the workflow needs them.

    Attributes
    ----------
    reference : tuple of str
    named : mapping of str to str
        Later sessions by the name of their file.
    refusal : str
        Why the data set cannot be tracked; empty where it can.
    """

    reference: tuple[str, ...]
    named: Mapping[str, str]
    refusal: str = ""


def name_sessions(dataset: str | Path) -> Tracked:
    """Sessions of a data set, the later ones by the name of their file; or why it cannot be tracked."""
    try:
        sessions = read_sessions(dataset)
    except InputError as error:
        return Tracked((), {}, str(error))
    return Tracked(sessions.reference, {file_name(session): session for session in sessions.later})


def file_name(session: str) -> str:
    """Name of a session's file: its label, or its plain characters with a digest of the label."""
    plain = re.sub(r"[^A-Za-z0-9_.-]+", "-", session).strip("-.")[:60]
    if plain == session:
        return plain
    return f"{plain or 'session'}-{hashlib.sha256(session.encode()).hexdigest()[:8]}"
