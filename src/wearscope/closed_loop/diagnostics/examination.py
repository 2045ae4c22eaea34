"""What the report shows beyond the verdict: residual profiles, forward simulation, the next measurement."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope.closed_loop.diagnostics.forward import compare_forward
from wearscope.closed_loop.diagnostics.next_measurement import plan_measurements, write_measurements
from wearscope.closed_loop.diagnostics.outcome import Outcome
from wearscope.closed_loop.diagnostics.profiles import UNITS as PROFILE_UNITS
from wearscope.closed_loop.diagnostics.profiles import profile_residuals
from wearscope.closed_loop.diagnostics.undetermined import find_undetermined
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.intake.signals import thin_signals
from wearscope.closed_loop.model.prediction import residual_table
from wearscope.storage import tables


def signal_table(prepared: Prepared) -> pd.DataFrame:
    """Signals at the rows of ``residual.parquet``, in the same order."""
    frames = []
    for run in prepared.runs:
        thin = thin_signals(run)
        coded = {"q": thin.q, "qd": thin.v, "qdd": thin.a, "load": thin.load, "temp": thin.temperature}
        coded["sign_qd"] = thin.sign
        for j, joint in enumerate(prepared.dataset.joints):
            own = {code: x[:, j] for code, x in coded.items()}
            frames.append(pd.DataFrame({"t": run.t, "run": run.file, "joint": joint, **own}))
    return pd.concat(frames, ignore_index=True)


def _units(prepared: Prepared) -> tuple[str, str]:
    """Units of position and torque; both units and 'by joint' where joints differ."""
    dataset = prepared.dataset
    position, torque = set(dataset.position_unit), set(dataset.torque_unit)
    return (
        position.pop() if len(position) == 1 else "rad or m, by joint",
        torque.pop() if len(torque) == 1 else "N m or N, by joint",
    )


def _write(out: Path, name: str, table: pd.DataFrame, prepared: Prepared, units: dict[str, str]) -> None:
    """Write a table with the units of its columns, which follow from their names or from `units`."""
    position, torque = _units(prepared)
    known = {"t": "s", "seconds": "s", "q": position, "qd": f"{position}/s", "qdd": f"{position}/s^2"}
    known |= {"load": torque, "temp": "degC", "measured": torque}
    known |= {column: position for column in table if column.startswith("motion_rms")}
    known |= {
        column: torque
        for column in table
        if column.startswith(("rms", "torque_rms", "simulated_")) and column not in known
    }
    chosen = {column: unit for column, unit in (known | units).items() if column in table}
    tables.write_table(out / f"{name}.parquet", table, chosen)


def examine(
    out: Path, diagnosis: Outcome, progress: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Examine a diagnosed data set and write the tables of the report.

    Parameters
    ----------
    out : Path
        Where ``signals.parquet``, ``profiles.parquet`` and ``forward.parquet`` are written.
    diagnosis : Outcome
    progress : callable

    Returns
    -------
    dict
        For ``verdict.json``: `undetermined`, `next_measurement`, `estimates` (every
        parameter of the model after with its interval) and `forward` (by joint and stage).
    """
    prepared, predicted = diagnosis.prepared, diagnosis.predicted
    progress("which effects the runs separate")
    undetermined = find_undetermined(diagnosis.problem, diagnosis.answer.limits)
    planned = plan_measurements(diagnosis, progress)
    forward = compare_forward(prepared, diagnosis.models, progress)
    signals = signal_table(prepared)
    profiles = profile_residuals(residual_table(prepared, predicted), signals)
    for name, table, units in (
        ("signals", signals, {}),
        ("profiles", profiles, PROFILE_UNITS),
        ("forward", forward, {}),
    ):
        _write(Path(out), name, table, prepared, units)
    return {
        "undetermined": undetermined,
        "next_measurement": write_measurements(Path(out), planned, prepared.dataset.joints),
        "estimates": _list_estimates(diagnosis),
        "forward": _by_joint(forward[forward["run"] == "all"], ["torque_rms", "motion_rms", "outcome"]),
    }


def _list_estimates(diagnosis: Outcome) -> list[dict[str, Any]]:
    """Every parameter of the model after, with its 95 % interval where it was estimated."""
    joints = diagnosis.prepared.dataset.joints
    return [
        {
            "joint": joints[one.entry.joint],
            "effect": one.entry.effect.name,
            "parameters": {
                name: {"value": _plain(one.values[name]), "ci95": [_plain(low), _plain(high)]}
                for name, (low, high) in one.intervals.items()
            },
        }
        for one in diagnosis.estimates["after"]
    ]


def _by_joint(table: pd.DataFrame, columns: list[str]) -> dict[str, dict[str, dict[str, Any]]]:
    """Values of a table's columns for JSON, nested by joint and stage."""
    nested: dict[str, dict[str, dict[str, Any]]] = {}
    for row in table.to_dict("records"):
        values = {name: _plain(row[name]) for name in columns}
        nested.setdefault(row["joint"], {})[row["stage"]] = values
    return nested


def _plain(value: Any) -> Any:
    if isinstance(value, str):
        return value
    return float(value) if np.isfinite(value) else None
