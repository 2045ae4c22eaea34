"""The machine-readable outcome, and the tables with it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wearscope.closed_loop.diagnostics.error_change import ErrorChange
from wearscope.closed_loop.diagnostics.outcome import Outcome
from wearscope.closed_loop.diagnostics.structure import JointState
from wearscope.closed_loop.intake.dataset import Dataset
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.estimation import Estimate
from wearscope.closed_loop.model.events import suggest_thresholds
from wearscope.closed_loop.model.prediction import (
    Predicted,
    bootstrap_rms,
    noise_floor,
    pooled_rms,
    relative_error,
    rms,
)
from wearscope.effects.viscous import EFFECT as VISCOUS
from wearscope.storage.provenance import name_version

_SEED = 7


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def make_verdict(diagnosis: Outcome) -> dict[str, Any]:
    """The content of ``verdict.json``: refuted terms first, then in the order of what they remove."""
    prepared = diagnosis.prepared
    joints = prepared.dataset.joints
    entries = []
    first = len(diagnosis.proposed.entries) - len(diagnosis.attributions)
    proposed = diagnosis.estimates["proposed"][first:]
    kept = {id(estimate.entry): estimate for estimate in diagnosis.estimates["after"]}
    for named, estimate in zip(diagnosis.attributions, proposed, strict=True):
        # Values are those of the corrected model, where it has the name.
        estimate = kept.get(id(named.term), estimate)
        term, j = named.term, named.term.joint
        units = prepared.dataset.position_unit[j], prepared.dataset.torque_unit[j]
        unit_of = {p.name: p.unit_at(*units) for p in term.effect.parameters}
        entries.append(
            {
                "joint": joints[j],
                "effect": term.effect.name,
                "equivalent": named.equivalent,
                "probability": named.probability,
                "depends_on": list(dict.fromkeys(term.effect.name_signals(term.shape, joints, j))),
                "parameters": {
                    name: {"value": estimate.values[name], "ci95": list(interval), "unit": unit_of[name]}
                    for name, interval in estimate.intervals.items()
                },
                "fixed": {
                    name: value for name, value in estimate.values.items() if name not in estimate.intervals
                },
                "error_reduction": _number(named.marked.reduction),
                "error_reduction_ci95": [_number(v) for v in named.marked.interval],
                "status": named.marked.status,
                "in_model": named.kept,
                "left_out": named.withdrawn or None,
            }
        )
    runs = [p.run for p in diagnosis.predicted]
    left = [p.run.measured - p.after for p in diagnosis.predicted]
    entries.sort(key=lambda entry: entry["status"] != "refuted")
    return {
        "dataset": prepared.dataset.name,
        "dataset_digest": prepared.dataset.digest,
        "verdict": entries,
        "contradictory_runs": sorted(
            {file for one in diagnosis.contradictions.values() for file in one.files}
        ),
        "time_delay": tell_common_delay(diagnosis),
        "events": diagnosis.events,
        "collision_thresholds": suggest_thresholds(runs, left, diagnosis.events, joints),
        "torque": prepared.torque_readings,
        "torque_factors": prepared.torque_factors,
        "far_links": diagnosis.far_links[0],
        "rule": diagnosis.policy.model_dump(),
        "version": name_version(),
        "joints": summarise_joints(
            prepared, diagnosis.predicted, diagnosis.states, diagnosis.error_changes, diagnosis.answer.limits
        ),
        "servos": list_speed_torques(prepared.dataset, diagnosis.estimates["after"]),
        "band": {"motion_hz": prepared.band.motion, "torque_hz": prepared.band.torque},
        "notes": prepared.notes + diagnosis.notes,
    }


def tell_common_delay(diagnosis: Outcome) -> dict[str, Any] | None:
    """The delay of the recorder by which several channels were moved; None where there is no such one."""
    dataset = diagnosis.prepared.dataset
    late = [a.term.joint for a in diagnosis.late]
    delays = {dataset.delays[j] for j in late} if dataset.delays else set()
    if len(late) < 2 or len(delays) > 1:
        return None
    named = diagnosis.late[0].term.effect.name
    return {"effect": named, "seconds": delays.pop(), "joints": [dataset.joints[j] for j in late]}


def summarise_joints(
    prepared: Prepared,
    predicted: list[Predicted],
    states: list[JointState],
    error_changes: list[ErrorChange],
    limits: list[dict[str, float]],
) -> dict[str, Any]:
    """Errors by joint over the test runs, at the common bandwidth, rows where the joint moves."""
    test = [p for p in predicted if p.run.use == "test"]
    floor = noise_floor(prepared, predicted)
    stages = ("declared", "before", "after")
    parts = {stage: [(p.run.measured - getattr(p, stage), p.run.keep) for p in test] for stage in stages}
    rows = max(4, int(4 * prepared.band.torque))
    value = {stage: pooled_rms(parts[stage]) for stage in stages}
    interval = {stage: bootstrap_rms(parts[stage], rows, _SEED) for stage in stages}
    summary: dict[str, Any] = {}
    # A gap splits a recording into several runs; the errors of a file are those of all of them together.
    by_file: dict[str, list[Predicted]] = {}
    for p in test:
        by_file.setdefault(p.run.file, []).append(p)
    for j, joint in enumerate(prepared.dataset.joints):
        runs, relative = {}, {}
        for file, own in by_file.items():
            left = [[p.run.measured - getattr(p, stage) for p in own] for stage in ("before", "after")]
            keep = np.concatenate([p.run.keep for p in own])
            measured = np.concatenate([p.run.measured for p in own])
            runs[file] = [_number(rms(np.concatenate(x), keep)[j]) for x in left]
            relative[file] = [_number(relative_error(np.concatenate(x), measured, keep)[j]) for x in left]
        summary[joint] = {
            "unit": prepared.dataset.torque_unit[j],
            "rms_as_declared": _number(value["declared"][j]),
            "rms_before": _number(value["before"][j]),
            "rms_before_ci95": [_number(v) for v in interval["before"][:, j]],
            "rms_after": _number(value["after"][j]),
            "rms_after_ci95": [_number(v) for v in interval["after"][:, j]],
            "noise_floor": None if floor is None else _number(floor[j]),
            "torque_rms": _number(error_changes[j].torque),
            "error": error_changes[j].error,
            "error_change_percent": _number(error_changes[j].change),
            "error_change_ci95": [_number(v) for v in error_changes[j].interval],
            "left_percent": _number(100.0 * error_changes[j].share),
            "state": states[j].state,
            "unexplained_rms": states[j].unexplained_rms,
            "depends_on": states[j].depends_on,
            "reason": states[j].reason,
            "detection_limit_percent": {name: _number(100.0 * one) for name, one in limits[j].items()},
            "test_runs": runs,
            "relative_error_percent": relative,
        }
    return summary


def list_speed_torques(dataset: Dataset, estimates: Sequence[Estimate]) -> dict[str, Any]:
    """What opposes a servo's speed: its law, the back-EMF that is known, and the viscous friction next to it.

    Parameters
    ----------
    dataset : Dataset
    estimates : sequence of Estimate
        Of the corrected model.

    Returns
    -------
    dict
        By joint: `law`; `back_emf`, which the torque is without; `speed_coefficient`, that and the viscous
        friction, with `ci95` where it was estimated [N m s/rad, or N s/m].
    """
    told: dict[str, Any] = {}
    for joint, servo in dataset.fields.servos.items():
        j = dataset.joints.index(joint)
        value = low = high = servo.back_emf
        for one in estimates:
            if one.entry.joint == j and one.entry.effect.name == VISCOUS.name:
                ends = one.intervals.get("slope", (one.values["slope"],) * 2)
                value, low, high = value + one.values["slope"], low + ends[0], high + ends[1]
        unit = f"{dataset.torque_unit[j]} s/{dataset.position_unit[j]}"
        told[joint] = {
            "law": servo.law,
            "back_emf": servo.back_emf,
            "speed_coefficient": {"value": value, "ci95": [low, high], "unit": unit},
        }
    return told
