"""Errors of a model on recordings, in torque and in position."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope.closed_loop.diagnostics.forward import (
    make_reference,
    mean_temperature,
    measured_motor_torque,
    recorded_temperature,
    with_payload,
)
from wearscope.closed_loop.intake.filtering import rows
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.intake.thinning import prepare_thinned
from wearscope.closed_loop.model.prediction import relative_error, rms
from wearscope.closed_loop.posing import read_measured
from wearscope.cycles.base import Reference
from wearscope.errors import InputError, SimulationError
from wearscope.robots.model import RobotModel
from wearscope.storage import tables

#: Times after its start at which a rollout's error is evaluated [s]; most rollouts of one recording.
HORIZONS = (0.1, 0.5, 2.0)
MOST_ROLLOUTS = 20
#: A joint counts as moving above this share of its highest speed.
MOVING = 0.01
#: Largest speed of a joint at rest that comes from rounding [rad/s or m/s].
_ROUNDING = 1e-9
_SEED, _DRAWS = 17, 400


@dataclass(frozen=True)
class ModelErrors:
    """Errors of a model on a data set.

    Attributes
    ----------
    torque : DataFrame
        One row for each run and joint: `run`, `use`, `joint`, `unit`, `seconds` (time in motion),
        `torque_rms` (measured) and `error_rms` over this time, `error_percent` (100 |e| / |tau|),
        `outcome` (``ok``, or why the simulation failed; errors are NaN then).
    rollouts : DataFrame
        One row for each run, joint and horizon: `run`, `use`, `joint`, `unit`, `seconds`, `count` (rollouts
        in which the joint moves), `failed` (rollouts that could not be simulated), `moved_median` (measured
        distance from start to end), `error_median` (distance from the measured position at the end) with its
        95 % interval (`error_median_low`, `error_median_high`).
    judged : dict
        What the torque errors cover: `joints`, number of judged joints; `of`, number of all; `names` of the
        judged joints; `seconds` of recordings; and `refused`, a sentence on each recording left out.
    """

    torque: pd.DataFrame
    rollouts: pd.DataFrame
    judged: dict[str, Any]

    def write(self, folder: str | Path) -> None:
        """Write ``evaluation.json``, ``torque_errors.parquet`` and ``rollout_errors.parquet``."""
        out = Path(folder)
        tables.write_json(out / "evaluation.json", {"judged": self.judged})
        units = {"seconds": "s", "error_percent": "%"}
        tables.write_table(out / "torque_errors.parquet", self.torque, units)
        tables.write_table(out / "rollout_errors.parquet", self.rollouts, {"seconds": "s"})


def evaluate_model(
    model: RobotModel,
    dataset: str | Path,
    progress: Callable[[str], None] = lambda _: None,
    temperature: float = np.nan,
) -> ModelErrors:
    """Compute the errors of a model on the recordings of a data set; nothing is fitted to them.

    The torque error compares the measured torque with that by which a controller keeps the model on the
    measured motion. A rollout starts at the measured state and applies the measured torque without feedback.
    Its position error after a time does not depend on a controller.

    Parameters
    ----------
    model : RobotModel
        Model with the same joints in the same order.
    dataset : path-like
        The data set's folder, or its ``dataset.yaml``.
    progress : callable
        Called with a line of text at each recording.
    temperature : float
        Joint temperature where it was not recorded [deg C].

    Raises
    ------
    InputError
        Where the data set does not have the required format, has other joints, or cannot be simulated at all.
    """
    read = read_measured(dataset)
    if list(read.joints) != list(model.joints):
        raise InputError(
            f"{dataset}: records the joints {', '.join(read.joints)}, and model '{model.name}' has "
            f"{', '.join(model.joints)}; give a model of the recorded joints, in their order."
        )
    prepared = prepare_thinned(read)
    torque: list[dict] = []
    rolled: list[dict] = []
    for recorded in prepared.runs:
        run = _with_temperature(recorded, temperature)
        torque += _list_torque_errors(prepared, model, run)
        rolled += _list_rollout_errors(prepared, model, run)
        progress(f"{run.label}: {torque[-1]['outcome']}")
    if all(one["outcome"] != "ok" for one in torque):
        more = "" if np.isfinite(temperature) else " One that was not recorded can be given: --temperature."
        raise InputError(f"{dataset}: none of it can be simulated; {torque[0]['outcome']}{more}")
    table = pd.DataFrame(torque)
    return ModelErrors(table, pd.DataFrame(rolled), count_judged(prepared, table))


def count_judged(prepared: Prepared, torque: pd.DataFrame) -> dict[str, Any]:
    """Return the joints, runs and time that a table of torque errors covers, see `ModelErrors.judged`."""
    known = torque[torque["error_percent"].notna()]
    names = [joint for joint in prepared.dataset.joints if joint in set(known["joint"])]
    runs = {run.label: float(run.t[-1] - run.t[0]) for run in prepared.runs}
    used = {run.file for run in prepared.runs}
    refused = [
        f"{record.file}: the robot stands still in it."
        for record in prepared.dataset.runs
        if record.file not in used
    ]
    failed = torque[torque["outcome"] != "ok"].drop_duplicates("run")
    refused += [f"{row.run}: {row.outcome}" for row in failed.itertuples()]
    seconds = sum(runs[run] for run in dict.fromkeys(known["run"]))
    return {
        "joints": len(names), "of": prepared.n, "names": names, "seconds": seconds, "refused": refused
    }  # fmt: skip


def _with_temperature(run: PreparedRun, temperature: float) -> PreparedRun:
    """Return a run with a temperature [deg C] in place of unknown ones."""
    own = run.signals.temperature
    signals = replace(run.signals, temperature=np.where(np.isfinite(own), own, temperature))
    return replace(run, signals=signals)


def _list_torque_errors(prepared: Prepared, model: RobotModel, run: PreparedRun) -> list[dict]:
    """Return the rows of the torque errors of a run, one for each joint."""
    # Imported here: the simulator imports PyBullet and compiled code.
    from wearscope.simulation.study import simulate_forward

    reference = make_reference(run)
    count = len(reference.t)
    length = len(range(count)[rows(run.band, count)])
    # Friction at rest can have any value up to break-away, so that a joint at rest is not judged.
    moves = (np.abs(run.signals.v) > np.maximum(MOVING * prepared.top_speed, _ROUNDING)).any(axis=0)
    keep, measured = run.keep[:length] & moves, run.measured[:length]
    try:
        loaded = with_payload(model, prepared, run)
        made = simulate_forward(
            loaded,
            reference,
            temperature=recorded_temperature(prepared, run, {"given": loaded}, count),
            controller_temperature=mean_temperature(run),
        )
        residual, outcome = measured - run.reduce(made.tau), "ok"
    except (SimulationError, InputError) as error:
        residual, outcome = np.full_like(measured, np.nan), f"failed: {error}"
    size, left, share = rms(measured, keep), rms(residual, keep), relative_error(residual, measured, keep)
    seconds = keep.sum(axis=0) * run.band.stride / run.band.rate
    return [
        _describe(prepared, run, j, prepared.dataset.torque_unit)
        | {
            "seconds": seconds[j],
            "torque_rms": size[j],
            "error_rms": left[j],
            "error_percent": share[j],
            "outcome": outcome,
        }
        for j in range(prepared.n)
    ]


def _list_rollout_errors(prepared: Prepared, model: RobotModel, run: PreparedRun) -> list[dict]:
    """Return the rows of the rollout errors of a run, one for each horizon and joint."""
    from wearscope.simulation.study import trace_forward

    s, rate = run.signals, run.band.rate
    lengths = [max(2, round(seconds * rate)) for seconds in HORIZONS]
    longest = max((k for k in lengths if k < len(s.t)), default=0)
    spread = np.linspace(0, len(s.t) - 1 - longest, MOST_ROLLOUTS if longest else 0)
    starts: list[int] = np.unique(spread.astype(int)).tolist()
    ends: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {length: [] for length in lengths}
    failed = 0
    for start in starts:
        part = slice(start, start + longest + 1)
        reference = Reference(np.arange(longest + 1) / rate, s.q[part], s.v[part], s.a[part])
        try:
            loaded = with_payload(model, prepared, run)
            trace, dt = trace_forward(
                loaded,
                reference,
                temperature=recorded_temperature(prepared, run, {"given": loaded}, longest + 1, start),
                feedforward=measured_motor_torque(loaded, run)[part],
                feedback=False,
            )
        except (SimulationError, InputError):
            failed += 1
            continue
        steps = round(1.0 / (rate * dt))
        for length in lengths:
            if length <= longest:
                moves = (np.abs(reference.v[:length]) > MOVING * prepared.top_speed).any(axis=0)
                moved = np.where(moves, np.abs(reference.q[length] - reference.q[0]), np.nan)
                ends[length].append((moved, np.abs(trace.q[length * steps] - reference.q[length])))
    return [
        _describe(prepared, run, j, prepared.dataset.position_unit)
        | {"seconds": seconds, "failed": failed}
        | _summarise([(moved[j], error[j]) for moved, error in ends[length] if np.isfinite(moved[j])])
        for seconds, length in zip(HORIZONS, lengths, strict=True)
        for j in range(prepared.n)
    ]


def _describe(prepared: Prepared, run: PreparedRun, joint: int, units: list[str]) -> dict:
    """Return the columns that name run, joint and unit."""
    return {"run": run.label, "use": run.use, "joint": prepared.dataset.joints[joint], "unit": units[joint]}


def _summarise(ends: list[tuple[float, float]]) -> dict[str, float]:
    """Return count, median motion and median error of a joint's rollouts, with a bootstrap interval."""
    if not ends:
        keys = ("moved_median", "error_median", "error_median_low", "error_median_high")
        return {"count": 0} | dict.fromkeys(keys, np.nan)
    moved, errors = np.array(ends).T
    drawn = np.random.default_rng(_SEED).integers(0, len(errors), (_DRAWS, len(errors)))
    low, high = np.quantile(np.median(errors[drawn], axis=1), [0.025, 0.975])
    return {
        "count": len(errors),
        "moved_median": float(np.median(moved)),
        "error_median": float(np.median(errors)),
        "error_median_low": float(low),
        "error_median_high": float(high),
    }
