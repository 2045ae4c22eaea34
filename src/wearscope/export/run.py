"""A model exported into a folder: URDF, MJCF, a table of parameters, and what the formats cannot hold."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope.cycles.base import Reference
from wearscope.cycles.planned import PlannedMotion
from wearscope.effects.base import load_effect
from wearscope.errors import need
from wearscope.export.holdings import FORMATS, take_holdings
from wearscope.robots.model import RobotModel
from wearscope.storage import tables
from wearscope.storage.verdicts import read_verdict

FILES = ("robot.urdf", "robot.xml", "isaac_lab.json", "parameters.csv", "export.json")
#: Motion along which MuJoCo is compared, and its step [s].
MOTION, STEP = PlannedMotion("points", pace=0.7, size=0.8, seconds=15.0), 0.004


def list_parameters(model: RobotModel, verdict: Mapping[str, Any] | None = None) -> pd.DataFrame:
    """Every parameter of a model's effects, one row each.

    Parameters
    ----------
    model : RobotModel
    verdict : mapping, optional
        ``verdict.json`` of the loop that made the model, which has the intervals.

    Returns
    -------
    DataFrame
        `joint`, `effect`, `parameter`, `value`, `low`, `high` (95 %; NaN where none is known), `unit`,
        `source`.
    """
    intervals = _read_intervals(verdict or {})
    rows = []
    for entry in model.effects:
        effect = load_effect(entry.effect).for_robot(model.n)
        j = model.joints.index(entry.joint)
        units = {p.name: p.unit_at(model.position_units[j], model.torque_units[j]) for p in effect.parameters}
        for name, value in entry.parameters.items():
            low, high = intervals.get((entry.joint, effect.name, name), (np.nan, np.nan))
            # A joint may have the same effect several times; an interval without the value is another one's.
            if not low <= value <= high:
                low = high = np.nan
            rows.append((entry.joint, effect.name, name, value, low, high, units[name], entry.source))
    for j in np.flatnonzero(model.rotor_inertia).tolist():
        unit = "kg m^2" if model.position_units[j] == "rad" else "kg"
        stated = (model.joints[j], "rotor_inertia", "inertia", float(model.rotor_inertia[j]))
        rows.append((*stated, np.nan, np.nan, unit, "stated by the drive"))
    columns = ["joint", "effect", "parameter", "value", "low", "high", "unit", "source"]
    return pd.DataFrame(rows, columns=columns)


def _read_intervals(verdict: Mapping[str, Any]) -> dict[tuple[str, str, str], tuple[float, float]]:
    found = {}
    for entry in [*verdict.get("estimates", []), *verdict.get("verdict", [])]:
        for name, one in entry.get("parameters", {}).items():
            low, high = one.get("ci95", (None, None))
            if low is not None and high is not None:
                found[entry["joint"], entry["effect"], name] = (float(low), float(high))
    return found


def export_model(
    model: RobotModel,
    folder: str | Path,
    verdict: Mapping[str, Any] | None = None,
    temperature: float = 50.0,
    reference: Reference | None = None,
) -> dict[str, Any]:
    """Write a model as URDF, MJCF and a table, with what they cannot hold.

    Parameters
    ----------
    model : RobotModel
    folder : path-like
        Folder in which `FILES` are written.
    verdict : mapping, optional
        ``verdict.json``, for the parameters' intervals.
    temperature : float
        Temperature for friction that depends on it [deg C].
    reference : Reference, optional
        Motion along which MuJoCo's torque is compared; moves between drawn postures by default.

    Returns
    -------
    dict
        The content of ``export.json``: `robot`, `temperature`, `left` (format, joint, effect, reason),
        `mujoco` (by joint: RMS torque, differences) and `replay` (see `compare_replays`); the last two are
        None where the model has no limits to plan a motion in.
    """
    need("mujoco")
    from wearscope.export.comparison import (
        compare,  # imported here: all three import MuJoCo
        compare_replays,
    )
    from wearscope.export.formats import write_isaac_lab, write_mjcf, write_urdf

    out = Path(folder)
    load = compared = replayed = None
    if reference is None and model.drive.speed_limit is not None:
        reference = MOTION.build(model, 0.05, STEP)
    if reference is not None:
        body = model.rigid_body(model.declared_payload)
        load = np.abs(body.inverse_dynamics(reference.q, reference.v, reference.a)).mean(axis=0)
    held = take_holdings(model, temperature, load)
    if reference is not None:
        found = compare(model, held, reference, temperature)
        compared = {
            joint: {"unit": model.torque_units[j], **{name: float(rms[j]) for name, rms in found.items()}}
            for j, joint in enumerate(model.joints)
        }
        replayed = compare_replays(model, held, reference, temperature)
    summary = {
        "robot": model.name,
        "temperature": temperature,
        "left": [asdict(one) for one in held.left],
        "mujoco": compared,
        "replay": replayed,
    }
    tables.write_text(out / "robot.urdf", write_urdf(model, held))
    tables.write_text(out / "robot.xml", write_mjcf(model, held))
    tables.write_text(out / "isaac_lab.json", write_isaac_lab(model, held))
    tables.write_text(out / "parameters.csv", list_parameters(model, verdict).to_csv(index=False))
    tables.write_json(out / "export.json", summary)
    return summary


def tell_export(summary: Mapping[str, Any]) -> list[str]:
    """A line for each thing that a format cannot hold, then for each format how far its replay is off."""
    grouped: dict[tuple[str, str, str], list[str]] = {}
    for one in summary["left"]:
        grouped.setdefault((one["format"], one["effect"], one["reason"]), []).append(one["joint"])
    said = [
        f"Not in {format}: {effect} of {', '.join(joints)}, as {reason}."
        for (format, effect, reason), joints in grouped.items()
    ]
    for format in FORMATS if summary["replay"] else ():
        ends = {joint: one["position"]["2"] for joint, one in summary["replay"][format].items()}
        joint = max(ends, key=lambda name: ends[name])
        size = f"{ends[joint]:.2g} {'m' if summary['mujoco'][joint]['unit'] == 'N' else 'rad'}"
        said.append(f"{format}, run again without feedback: off by {size} after 2 s, at {joint}.")
    return said


def read_verdict_of(path: Path) -> dict[str, Any] | None:
    """``verdict.json`` in the folder of a model file; None where there is none.

    Raises
    ------
    InputError
        Where that file is no verdict.
    """
    file = path.parent / "verdict.json"
    return read_verdict(file) if file.is_file() else None
