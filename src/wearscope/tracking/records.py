"""What a session's assessment leaves for the tables and the page: plain values, one record a session."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wearscope.effects.vocabulary import plain_friction
from wearscope.tracking.changes import CURVE, FRICTION, Change
from wearscope.tracking.inference import Estimate
from wearscope.tracking.reference import Reference
from wearscope.tracking.scatter import measure_friction, relative_change
from wearscope.tracking.session import Assessment, list_entries
from wearscope.tracking.structure import Structure
from wearscope.tracking.worn import record_worn


def record_assessment(assessment: Assessment, reference: Reference) -> dict[str, Any]:
    """Record of a later session: its changes, its table's rows and its series."""
    structure, scatter = reference.structure, reference.scatter
    named = {one.change.key: one for one in assessment.named}
    together = {**assessment.estimates, **{key: one.judged.estimate for key, one in named.items()}}
    return {
        "session": assessment.session,
        "changes": [
            {**entry, "key": one.change.key}
            for one in assessment.named
            for entry in list_entries([one], structure, scatter)
        ],
        "cannot_tell": assessment.cannot_tell,
        "events": assessment.events,
        "next_measurement": [plan.to_mapping(structure.joints) for plan in assessment.plans],
        "notes": assessment.notes,
        "wear": record_worn(assessment.worn, reference),
        "rows": list_rows(reference, together, set(named)),
        "series": list_series(reference, together),
    }


def record_reference(reference: Reference) -> dict[str, Any]:
    """Record of the reference: its healthy sessions, held out, and what is fixed."""
    structure, scatter = reference.structure, reference.scatter
    low, high = structure.warmth
    return {
        "sessions": [
            {
                "session": name,
                "rows": list_rows(reference, estimates, set()),
                "series": list_series(reference, estimates),
            }
            for name, estimates in reference.held_out.items()
        ],
        "joints": list(structure.joints),
        "terms": [
            {"joint": structure.joints[entry.joint], "effect": entry.effect.name}
            for entry in structure.entries
        ],
        "temperatures": {
            joint: [float(low[j]), float(high[j])] if np.isfinite(low[j]) else None
            for j, joint in enumerate(structure.joints)
        },
        "scatter": {
            "friction": scatter.friction,
            "torque": scatter.torque,
            "sessions": scatter.sessions,
        },
    }


def list_rows(
    reference: Reference, estimates: Mapping[str, Estimate], named: set[str]
) -> list[dict[str, Any]]:
    """Rows of ``changes.parquet``: each parameter with its interval, a joint's friction fitted as one.

    Parameters
    ----------
    reference : Reference
    estimates : mapping of str to Estimate
        By the change's key.
    named : set of str
        Keys of those that the session is said to show.
    """
    rows: list[dict[str, Any]] = []
    structure, scatter = reference.structure, reference.scatter
    for key, estimate in estimates.items():
        change = estimate.change
        if change.name == FRICTION:
            curve = estimates.get(f"{CURVE}@{change.joint}", estimate)
            share, half = measure_friction(curve, scatter)
            size = float(structure.scales.friction[change.joint])
            friction = (structure.torque_unit[change.joint], size, size * share, size * half)
            p = scatter.p_value(estimate)
            rows.append(_row(structure.joints[change.joint], FRICTION, "torque", *friction, p, key in named))
        if not change.asked or _is_shown_together(change, named):
            continue
        joint = structure.joints[change.joint]
        p, width = scatter.p_value(estimate), scatter.width(estimate)
        units = structure.position_unit[change.joint], structure.torque_unit[change.joint]
        for (effect, name), value, half in zip(change.parameters, estimate.value, width, strict=True):
            parameter = next(x for x in effect.coefficients if x.name == name)
            was = find_value(structure, reference.belief.mean, change, effect.name, name)
            unit = parameter.unit_at(*units)
            rows.append(_row(joint, effect.name, name, unit, was, float(value), float(half), p, key in named))
    return rows


def _is_shown_together(change: Change, named: set[str]) -> bool:
    """Whether a change's parameters stand in the rows of the joint's friction as a whole."""
    whole = f"{FRICTION}@{change.joint}"
    alone = {f"{effect.name}@{change.joint}" for effect in plain_friction()}
    if change.key in alone:
        return change.key not in named
    return change.key == whole and bool(alone & named)


def _row(
    joint: str, effect: str, parameter: str, unit: str, was: float, change: float, half: float, p: float,
    named: bool,
) -> dict[str, Any]:  # fmt: skip
    value = was + change
    return {
        "joint": joint, "effect": effect, "parameter": parameter, "unit": unit,
        "value": value, "value_low": value - half, "value_high": value + half,
        "change": change, "change_low": change - half, "change_high": change + half,
        "p": p, "named": named,
    }  # fmt: skip


def find_value(structure: Structure, mean: np.ndarray, change: Change, effect: str, parameter: str) -> float:
    """Value of a parameter in the reference; zero of what it does not have."""
    for entry, span in zip(structure.entries, structure.spans, strict=True):
        if entry.effect.name == effect and entry.joint == change.joint:
            names = [entry.effect.coefficients[k].name for k in entry.subset]
            if parameter in names:
                return float(mean[span][names.index(parameter)])
    return 0.0


def list_series(reference: Reference, estimates: Mapping[str, Estimate]) -> dict[str, list[float]]:
    """Size of each change as a share of its joint's torque, signed, and its standard error, by key."""
    found = {}
    for key, estimate in estimates.items():
        share, half = relative_change(estimate, reference.scatter)
        found[key] = [share, half / 1.96]
    return found


def collect_series(records: Sequence[Mapping[str, Any]], key: str) -> np.ndarray:
    """Sizes and standard errors (2, S) of a change over sessions; NaN where a session shows none."""
    missing = [np.nan, np.nan]
    return np.array([record["series"].get(key, missing) for record in records], dtype=float).T
