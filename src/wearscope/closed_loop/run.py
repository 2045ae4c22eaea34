"""Closing the loop on one data set, from its folder to the files of the contract."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.drawing import draw_models
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.names import drawn_path
from wearscope.robots.model import save_model


def close_loop(
    dataset: str | Path,
    out_dir: str | Path,
    light: bool = False,
    policy: Policy | None = None,
    progress: Callable[[str], None] = lambda _: None,
    effects: Sequence[str | Path] = (),
    allow_code: bool = False,
    draws: int = 0,
) -> dict[str, Any]:
    """Close the loop on a data set and write what was found.

    Parameters
    ----------
    dataset : path-like
        The data set's folder, or its ``dataset.yaml``.
    out_dir : path-like
        Where ``verdict.json``, ``residual.parquet``, ``candidates.parquet``, ``model_before.yaml``,
        ``model_after.yaml`` and, unless `light`, the tables of the diagnostics are written.
    light : bool
        Leave out forward simulation, diagnostics and the report.
    draws : int
        Models of each stage that the data allow, written to ``drawn/`` (`draw_models`).
    policy, progress, effects, allow_code
        As of `diagnose`.

    Returns
    -------
    dict
        The content of ``verdict.json``.

    Raises
    ------
    InputError
        Where the data set breaks the format or cannot be what it says; nothing is written then.
    """
    diagnosis = diagnose(dataset, policy, progress, effects, allow_code)
    extra: dict[str, Any] = {}
    if not light:
        from wearscope.closed_loop.diagnostics.examination import examine

        extra = examine(Path(out_dir), diagnosis, progress)
    for stage in ("before", "after") if draws else ():
        for number, model in enumerate(draw_models(diagnosis, stage, draws, diagnosis.policy.seed), start=1):
            save_model(model, Path(out_dir) / drawn_path(stage, number))
    return diagnosis.write(out_dir, extra)
