"""Closing the loop on one data set, from its folder to the files of the contract."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from wearscope import tables
from wearscope.closed_loop.model.prediction import predict_runs
from wearscope.closed_loop.selection.rule import TraceOptions
from wearscope.closed_loop.model.correction import make_corrected_model, write_models
from wearscope.closed_loop.intake.dataset import Dataset, read_dataset
from wearscope.closed_loop.model.estimation import estimate
from wearscope.closed_loop.intake.plausibility import check_plausibility
from wearscope.closed_loop.intake.preprocessing import Prepared, prepare
from wearscope.closed_loop.selection.search import Trace, Tracer
from wearscope.closed_loop.verdict import make_verdict, residual_table
from wearscope.errors import InputError
from wearscope.robots.urdf_file import parse_urdf

RESIDUAL_UNITS = {"t": "s"}


def find_prismatic(urdf: Path, joints: list[str]) -> list[bool]:
    """Whether each named joint of a URDF is prismatic.

    Raises
    ------
    InputError
        Where the URDF has no such joint.
    """
    kinds = {joint.name: joint.kind for joint in parse_urdf(urdf).joints}
    for name in joints:
        if name not in kinds:
            raise InputError(f"{urdf}: there is no joint '{name}'; robot.joints may name {', '.join(kinds)}.")
    return [kinds[name] == "prismatic" for name in joints]


def trace_dataset(
    dataset: Dataset, options: TraceOptions | None = None, progress: Callable[[str], None] = lambda _: None
) -> tuple[Prepared, Trace]:
    """Prepare a data set, check that it can be what it says, and trace its residual."""
    prepared = prepare(dataset)
    check_plausibility(prepared)
    progress("; ".join(prepared.notes))
    tracer = Tracer(prepared, options or TraceOptions(), progress)
    return prepared, tracer.run()


def close_loop(
    dataset: str | Path,
    out_dir: str | Path,
    light: bool = False,
    options: TraceOptions | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Close the loop on a data set.

    Parameters
    ----------
    dataset : path-like
        The data set's folder, or its ``dataset.yaml``.
    out_dir : path-like
        Where ``verdict.json``, ``residual.parquet``, ``candidates.parquet``, ``model_before.yaml``,
        ``model_after.yaml`` and, unless `light`, ``forward.parquet``, ``isolability.parquet``,
        ``dependence.parquet`` and ``black_box.parquet`` are written.
    light : bool
        Leave out forward simulation, diagnostics and the report.
    options : TraceOptions, optional
    progress : callable
        Called with a line of text at each step.

    Returns
    -------
    dict
        The content of ``verdict.json``.

    Raises
    ------
    InputError
        Where the data set breaks the format or cannot be what it says; nothing is written then.
    """
    path = Path(dataset)
    folder = path.parent if path.suffix in (".yaml", ".yml") else path
    read = read_dataset(folder, find_prismatic)
    prepared, trace = trace_dataset(read, options, progress)
    predicted = predict_runs(prepared, trace.before, trace.after)
    estimates = {"before": estimate(trace.before), "after": estimate(trace.after)}
    models = {
        "before": make_corrected_model(prepared, trace.before, estimates["before"], "before"),
        "after": make_corrected_model(prepared, trace.after, estimates["after"], "after"),
    }
    verdict = make_verdict(prepared, trace, estimates["after"], predicted)
    out = Path(out_dir)
    units = dict.fromkeys(
        ("measured", "predicted_before", "predicted_after", "residual_before", "residual_after"),
        read.torque_unit[0] if len(set(read.torque_unit)) == 1 else "N m or N, by joint",
    )
    write_models(out, models)
    tables.write_table(out / "residual.parquet", residual_table(prepared, predicted), RESIDUAL_UNITS | units)
    tables.write_table(out / "candidates.parquet", pd.DataFrame(trace.candidates))
    if not light:
        from wearscope.closed_loop.diagnostics.examination import examine

        verdict |= examine(out, prepared, trace, predicted, models, progress)
    tables.write_text(out / "verdict.json", json.dumps(verdict, indent=2) + "\n")
    return verdict
