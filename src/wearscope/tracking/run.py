"""Tracking a data set in stages: the reference once, each later session by itself, then all of them."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.intake.data_folder import digest_dataset
from wearscope.closed_loop.intake.dataset_fields import load_fields
from wearscope.closed_loop.intake.threads import keep_to_one_thread
from wearscope.effects.base import load_effect
from wearscope.robots.model import save_model
from wearscope.storage import tables
from wearscope.storage.files import read_json
from wearscope.storage.provenance import name_version
from wearscope.tracking.changes import FRICTION
from wearscope.tracking.evidence import FALSE_ALARM_RATE, PRIOR_FRICTION
from wearscope.tracking.records import collect_series, describe_reference, record_assessment, record_healthy
from wearscope.tracking.reference import Reference, identify_reference
from wearscope.tracking.session import assess_session
from wearscope.tracking.session_names import Sessions, read_sessions
from wearscope.tracking.storage import load_reference, save_reference
from wearscope.tracking.tracked_model import STAGE, make_tracked_model
from wearscope.tracking.trend import FRICTION_LIMIT, find_segments, find_since, fit_trend, leave_healthy

Say = Callable[[str], None]
_COLUMNS = [
    "session", "joint", "effect", "parameter", "value", "value_low", "value_high", "change", "change_low",
    "change_high", "unit", "p", "named", "healthy",
]  # fmt: skip
_UNITS = dict.fromkeys(
    ("value", "value_low", "value_high", "change", "change_low", "change_high"), "of the column unit"
)


def write_reference(
    dataset: str | Path,
    path: str | Path,
    policy: Policy | None = None,
    progress: Say = lambda _: None,
    effects: Sequence[str | Path] = (),
    allow_code: bool = False,
) -> None:
    """Identify the healthy machine of a data set and write it to a file.

    Raises
    ------
    InputError
        Where the data set has no reference, or breaks the format.
    """
    reference, healthy = identify_reference(read_sessions(dataset), policy, progress, effects, allow_code)
    save_reference(path, reference, record_healthy(reference, healthy))


def write_session(
    dataset: str | Path,
    session: str,
    reference: str | Path,
    path: str | Path,
    level: float = FALSE_ALARM_RATE,
    effects: Sequence[str] = (),
    allow_code: bool = False,
) -> dict[str, Any]:
    """Compare one session with a reference that was written, and write the session's record as JSON."""
    healthy, _ = load_reference(reference, effects, allow_code)
    record = record_assessment(assess_session(read_sessions(dataset), session, healthy, level), healthy)
    tables.write_json(path, record)
    return record


def join_sessions(
    dataset: str | Path,
    reference: str | Path,
    records: Sequence[str | Path],
    folder: str | Path,
    level: float = FALSE_ALARM_RATE,
    limit: float | None = None,
    effects: Sequence[str] = (),
    allow_code: bool = False,
) -> dict[str, Any]:
    """Write ``changes.parquet`` and ``tracking.json`` from the sessions' records."""
    read = [read_json(path) for path in records]
    healthy, before = load_reference(reference, effects, allow_code)
    return write_tracking(read_sessions(dataset), healthy, before, read, folder, level, limit)


@keep_to_one_thread
def track(
    dataset: str | Path,
    folder: str | Path,
    policy: Policy | None = None,
    level: float = FALSE_ALARM_RATE,
    limit: float | None = None,
    progress: Say = lambda _: None,
    effects: Sequence[str | Path] = (),
    allow_code: bool = False,
) -> dict[str, Any]:
    """All stages at once: what changed since the machine was healthy.

    Parameters
    ----------
    dataset : path-like
        The data set's folder, or its ``dataset.yaml``.
    folder : path-like
        Where ``tracking.json`` and ``changes.parquet`` are written.
    policy, progress, effects, allow_code
        See `wearscope.closed_loop.diagnosis.diagnose`.
    level : float
        False-alarm rate of a session, over all joints and changes.
    limit : float, optional
        Limit of the rise of a joint's friction, as a share of the healthy friction; the number of sessions
        until it is reached is estimated. `FRICTION_LIMIT`, marked as assumed, where left out.

    Returns
    -------
    dict
        The content of ``tracking.json``.

    Raises
    ------
    InputError
        Where the data set has no reference, or breaks the format; nothing is written then.
    """
    sessions = read_sessions(dataset)
    reference, healthy = identify_reference(sessions, policy, progress, effects, allow_code)
    before, records = record_healthy(reference, healthy), []
    for session in sessions.later:
        records.append(record_assessment(assess_session(sessions, session, reference, level), reference))
        progress(f"{session}: {tell_changes(records[-1])}")
    return write_tracking(sessions, reference, before, records, folder, level, limit)


def tell_changes(record: dict[str, Any]) -> str:
    """What a session shows, in a few words."""
    said = [f"{c['effect']} of {c['joint']} {c['change']:+.3g} {c['unit']}" for c in record["changes"]]
    if record["events"]:
        said.append(f"{len(record['events'])} short events")
    return "; ".join(said) or ("cannot tell" if record["cannot_tell"] else "no change")


def write_tracking(
    sessions: Sessions, reference: Reference, healthy: Sequence[dict[str, Any]],
    records: Sequence[dict[str, Any]], folder: str | Path, level: float, limit: float | None,
) -> dict[str, Any]:  # fmt: skip
    """Write ``changes.parquet``, ``model_tracked.yaml``, then ``tracking.json``; records in any order."""
    by_name = {record["session"]: record for record in records}
    later = [by_name[session] for session in sessions.later]
    rows = [
        {"session": record["session"], "healthy": is_healthy, **row}
        for is_healthy, part in ((True, healthy), (False, later))
        for record in part
        for row in record["rows"]
    ]
    worn = [{"session": r["session"], **one} for r in later for one in r["wear"]]
    told = {
        "dataset": sessions.name,
        "dataset_digest": digest_dataset(sessions.folder, load_fields(sessions.folder / "dataset.yaml")),
        "reference": list(reference.sessions),
        "false_alarm_rate": level,
        "friction_limit": limit or FRICTION_LIMIT,
        "friction_limit_assumed": limit is None,
        "reference_scatter": reference.scattering,
        "sessions": [
            {
                "session": record["session"],
                "changes": [tell_entry(entry, k, healthy, later) for entry in record["changes"]],
                **{key: record[key] for key in ("cannot_tell", "smallest_visible", "events")},
            }
            for k, record in enumerate(later)
        ],
        "trends": list_trends(reference.structure.joints, later, limit or FRICTION_LIMIT),
        "wear": worn,
        "healthy": describe_reference(reference, healthy),
        "notes": [*sessions.notes, *tell_scatter(reference), *(n for r in later for n in r["notes"])],
        "version": name_version(),
    }
    table = pd.DataFrame(rows, columns=_COLUMNS)
    tables.write_table(Path(folder) / "changes.parquet", table, _UNITS)
    save_model(make_tracked_model(reference.robot, worn), Path(folder) / f"model_{STAGE}.yaml")
    tables.write_json(Path(folder) / "tracking.json", told)
    return told


def tell_entry(
    entry: dict[str, Any], k: int, healthy: Sequence[dict[str, Any]], later: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """Entry of a change in the `k`-th later session, with the session from which it counts."""
    key = series_key(entry)
    values, errors = collect_series([*healthy, *later], key)
    segments = leave_healthy(find_segments(values, errors), len(healthy))
    counting = [key in map(series_key, record["changes"]) for record in later]
    since = find_since(counting, segments, k)
    ordered = ("joint", "effect", "parameter", "change", "ci95", "unit")
    return {
        **{name: entry[name] for name in ordered},
        "since": later[since]["session"],
        "equivalent": entry["equivalent"],
        **({"anywhere": entry["anywhere"]} if entry["anywhere"] else {}),
    }


def series_key(entry: dict[str, Any]) -> str:
    """Key of the series of a change; a joint has one series for friction of any form."""
    joint = entry["key"].partition("@")[2]
    return f"{FRICTION}@{joint}" if load_effect(entry["effect"]).is_friction else entry["key"]


def list_trends(joints: Sequence[str], later: Sequence[dict[str, Any]], limit: float) -> list[dict[str, Any]]:
    """Trend of each joint's friction over the later sessions; slopes are shares of friction per session."""
    series = [collect_series(later, f"{FRICTION}@{j}") for j in range(len(joints))]
    trends = [fit_trend(values, errors, limit) for values, errors in series]
    return [
        {
            "joint": joint,
            "effect": FRICTION,
            "slope": trend.slope,
            "ci95": [trend.low, trend.high],
            "unit": "1/session",
            "p": trend.p_value,
            "sessions_left": list(trend.left),
        }
        for joint, trend in zip(joints, trends, strict=True)
        if trend is not None
    ]


def tell_scatter(reference: Reference) -> list[str]:
    """Notes on sessions that were left out, and on a reference that shows no scatter between sessions."""
    said = [
        f"session {one['session']} of the reference is not one with the others and was left out: at "
        f"{one['joint']} it leaves {one['rms']:.3g} of their prediction, and they "
        f"leave {one['others']:.3g} (RMS torque). If the machine was healthy and free in it, the other "
        "sessions were not."
        for one in reference.scattering
    ]
    if len(reference.sessions) == 1:
        said.append(
            "the reference is one session, which does not show how healthy sessions differ; "
            f"{100 * PRIOR_FRICTION:.2g} % of friction is assumed. Add healthy sessions."
        )
    return said
