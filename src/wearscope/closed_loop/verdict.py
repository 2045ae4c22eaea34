"""The machine-readable outcome, and the tables beside it."""

from typing import Any

import numpy as np
import pandas as pd

from wearscope.closed_loop.model.prediction import (
    Predicted,
    bootstrap_rms,
    noise_floor,
    pooled_rms,
    predict_full,
    refit,
    relative_error,
    rms,
)
from wearscope.closed_loop.model.estimation import Estimate
from wearscope.closed_loop.intake.preprocessing import Prepared
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.selection.evidence import Found
from wearscope.closed_loop.selection.search import Trace
from wearscope.effects.unknown import name_signals

_SEED = 7


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def depends_on(found: Found, joints: list[str]) -> list[str]:
    """Signals that a named effect depends on."""
    entry = found.entry
    if entry.effect.name == "unknown":
        return name_signals(entry.shape, joints, entry.joint)
    other = joints[int(entry.shape[0])] if entry.effect.name == "cross_coupling" else ""
    return [name.format(joint=joints[entry.joint], other=other) for name in entry.effect.depends_on]


def reduction_by_step(prepared: Prepared, trace: Trace) -> list[float]:
    """Share of the held-out residual variance that each effect removes when it is added, in order."""
    shares = []
    declared = len(trace.before.entries)
    last = _held_out_power(prepared, trace.before)
    for k in range(len(trace.found)):
        model = refit(trace.before, trace.after.entries[: declared + k + 1])
        now = _held_out_power(prepared, model)
        entry = trace.found[k].entry
        joint = slice(None) if entry.effect.spread else [entry.joint]
        weight = 1.0 / trace.before.sigma[joint] ** 2
        shares.append(float(1.0 - (now[joint] * weight).sum() / (last[joint] * weight).sum()))
        last = now
    return shares


def _held_out_power(prepared: Prepared, model: Regression) -> np.ndarray:
    theta = model.solve()
    total = np.zeros(prepared.n)
    for run in prepared.runs_for("test"):
        residual = run.measured - run.reduce(predict_full(model, theta, run))
        total += (residual**2 * run.keep).sum(axis=0)
    return total


def make_verdict(
    prepared: Prepared, trace: Trace, estimates: list[Estimate], predicted: list[Predicted]
) -> dict[str, Any]:
    """The content of ``verdict.json``."""
    joints = prepared.dataset.joints
    shares = reduction_by_step(prepared, trace)
    entries = []
    for found, estimate, share in zip(
        trace.found, estimates[len(trace.before.entries) :], shares, strict=True
    ):
        j = found.entry.joint
        units = prepared.dataset.position_unit[j], prepared.dataset.torque_unit[j]
        unit_of = {p.name: p.unit_at(*units) for p in found.entry.effect.parameters}
        entries.append(
            {
                "joint": joints[j],
                "effect": found.entry.effect.name,
                "equivalent": found.equivalent,
                "depends_on": depends_on(found, joints),
                "parameters": {
                    name: {"value": estimate.values[name], "ci95": list(interval), "unit": unit_of[name]}
                    for name, interval in estimate.intervals.items()
                },
                "fixed": {
                    name: value for name, value in estimate.values.items() if name not in estimate.intervals
                },
                "error_reduction": share,
            }
        )
    return {
        "dataset": prepared.dataset.name,
        "verdict": entries,
        "joints": summarise_joints(prepared, predicted),
        "band": {"motion_hz": prepared.band.motion, "torque_hz": prepared.band.torque},
        "notes": prepared.notes,
    }


def summarise_joints(prepared: Prepared, predicted: list[Predicted]) -> dict[str, Any]:
    """Errors by joint over the test runs, at the common bandwidth, rows where the joint moves."""
    test = [p for p in predicted if p.run.use == "test"]
    floor = noise_floor(prepared, predicted)
    stages = ("declared", "before", "after")
    parts = {stage: [(p.run.measured - getattr(p, stage), p.run.keep) for p in test] for stage in stages}
    rows = max(4, int(4 * prepared.band.torque))
    value = {stage: pooled_rms(parts[stage]) for stage in stages}
    interval = {stage: bootstrap_rms(parts[stage], rows, _SEED) for stage in stages}
    summary = {}
    for j, joint in enumerate(prepared.dataset.joints):
        runs = {
            p.run.file: [_number(rms(p.run.measured - s, p.run.keep)[j]) for s in (p.before, p.after)]
            for p in test
        }
        relative = {
            p.run.file: [
                _number(relative_error(p.run.measured - s, p.run.measured, p.run.keep)[j])
                for s in (p.before, p.after)
            ]
            for p in test
        }
        summary[joint] = {
            "unit": prepared.dataset.torque_unit[j],
            "rms_as_declared": _number(value["declared"][j]),
            "rms_before": _number(value["before"][j]),
            "rms_before_ci95": [_number(v) for v in interval["before"][:, j]],
            "rms_after": _number(value["after"][j]),
            "rms_after_ci95": [_number(v) for v in interval["after"][:, j]],
            "noise_floor": None if floor is None else _number(floor[j]),
            "test_runs": runs,
            "relative_error_percent": relative,
        }
    return summary


def residual_table(prepared: Prepared, predicted: list[Predicted]) -> pd.DataFrame:
    """Long table of measured and predicted torque of every run."""
    frames = []
    for p in predicted:
        for j, joint in enumerate(prepared.dataset.joints):
            frames.append(
                pd.DataFrame(
                    {
                        "t": p.run.t,
                        "run": p.run.file,
                        "use": p.run.use,
                        "joint": joint,
                        "measured": p.run.measured[:, j],
                        "predicted_before": p.before[:, j],
                        "predicted_after": p.after[:, j],
                        "residual_before": p.run.measured[:, j] - p.before[:, j],
                        "residual_after": p.run.measured[:, j] - p.after[:, j],
                        "counts": p.run.keep[:, j],
                    }
                )
            )
    return pd.concat(frames, ignore_index=True)
