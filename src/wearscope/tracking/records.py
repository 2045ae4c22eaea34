"""Records of sessions for the tables and the page: plain values, one record per session."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wearscope.tracking.changes import FRICTION, Change
from wearscope.tracking.evidence import Evidence
from wearscope.tracking.reference import Healthy, Reference
from wearscope.tracking.session import WIDTH, Assessment, list_entries, measure_share
from wearscope.tracking.structure import Structure
from wearscope.tracking.worn import record_worn


def record_assessment(assessment: Assessment, reference: Reference) -> dict[str, Any]:
    """Record of a later session: its changes, its table's rows and its series."""
    entries = list_entries(assessment, reference)
    estimates = list_estimates(reference, assessment.evidence, assessment.named, assessment.felt)
    told = {(e["joint"], e["effect"], e["parameter"]): e for e in entries if e["unit"] == "kg"}
    for row in estimates["rows"]:
        entry = told.get((row["joint"], row["effect"], row["parameter"]))
        if entry is not None and row["named"]:  # a body's mass, as `tracking.json` states it
            low, high = entry["ci95"]
            row |= {"change": entry["change"], "change_low": low, "change_high": high}
            row |= {"value": entry["change"], "value_low": low, "value_high": high}
    return {
        "session": assessment.session,
        "changes": entries,
        "cannot_tell": assessment.cannot_tell,
        "smallest_visible": assessment.smallest,
        "events": assessment.events,
        "notes": assessment.notes,
        "wear": record_worn(assessment.worn, reference),
        **estimates,
    }


def record_healthy(reference: Reference, healthy: Sequence[Healthy]) -> list[dict[str, Any]]:
    """Records of the healthy sessions, each against the others."""
    structure, records = reference.structure, []
    recorded = bool(np.isfinite(structure.temperature[structure.moving]).all())
    for one in healthy:
        evidence = reference.weigh(one.made, belief=one.belief)
        felt = evidence if recorded else reference.weigh(one.made, belief=one.belief, of_temperature=False)
        records.append({"session": one.name, **list_estimates(reference, evidence, (), felt)})
    return records


def describe_reference(reference: Reference, healthy: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Numbers of the healthy machine that later sessions do not change."""
    structure = reference.structure
    low, high = structure.warmth
    friction, torque = np.split(reference.scatter.reshape(len(structure.moving), -1), [3], axis=1)
    return {
        "terms": [
            {"joint": structure.joints[entry.joint], "effect": entry.effect.name}
            for entry in structure.entries
        ],
        "temperatures": {
            joint: [float(low[j]), float(high[j])] if np.isfinite(low[j]) else None
            for j, joint in enumerate(structure.joints)
        },
        "scatter": {
            "friction": float(np.median(np.linalg.norm(friction, axis=1))),
            "torque": float(np.median(np.linalg.norm(torque, axis=1))),
            "sessions": len(healthy),
        },
    }


def list_estimates(
    reference: Reference, evidence: Evidence, named: Sequence[Change], felt: Evidence
) -> dict[str, Any]:
    """Rows of ``changes.parquet``, and series: each change is fitted together with the named changes.

    Each joint's friction has one row for its RMS torque, from the evidence `felt`. A series holds a change's
    signed share of its joint's friction or torque, and the standard error.
    """
    structure, rows, series = reference.structure, [], {}
    for change in evidence.changes:
        rest = [c for c in named if (c.kind, c.joint) != (change.kind, change.joint)]
        if not np.any(evidence.z[:, :, evidence.at[change.key]]):
            continue
        weighed = felt if change.name == FRICTION else evidence
        fit = weighed.fit([*rest, change])
        share, error = measure_share(weighed, fit, change)
        series[change.key] = [share, error]
        p, joint, is_named = fit.p_value(change), structure.joints[change.joint], change in named
        if change.name == FRICTION:
            size = float(structure.scales.friction[change.joint])
            told = (structure.torque_unit[change.joint], size, size * share, WIDTH * size * error)
            own = any(c.kind == FRICTION and c.joint == change.joint for c in named)
            rows.append(_row(joint, FRICTION, "torque", *told, p, own))
        if change.weights or (change.name != change.effects[0] and not is_named):
            continue
        values, errors = fit.values[change.key], fit.error(change)
        units = structure.position_unit[change.joint], structure.torque_unit[change.joint]
        for (effect, parameter), value, half in zip(change.parameters, values, WIDTH * errors, strict=True):
            name, unit = parameter.name, parameter.unit_at(*units)
            was = find_value(structure, reference.belief.mean, change, effect.name, name)
            rows.append(_row(joint, effect.name, name, unit, was, float(value), float(half), p, is_named))
    return {"rows": rows, "series": series}


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
    """Value of a parameter in the reference; zero where the reference has no such parameter."""
    for entry, span in zip(structure.entries, structure.spans, strict=True):
        if entry.effect.name == effect and entry.joint == change.joint:
            names = [entry.effect.coefficients[k].name for k in entry.subset]
            if parameter in names:
                return float(mean[span][names.index(parameter)])
    return 0.0


def collect_series(records: Sequence[Mapping[str, Any]], key: str) -> np.ndarray:
    """Sizes and standard errors (2, S) of a change over sessions; NaN where a session shows none."""
    missing = [np.nan, np.nan]
    return np.array([record["series"].get(key, missing) for record in records], dtype=float).T
