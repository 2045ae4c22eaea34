"""Forward simulation of the models before and after along the measured motion, against the recording."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from wearscope.closed_loop.intake.dataset_fields import state_payload
from wearscope.closed_loop.intake.filtering import rows
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.model.delays import find_shift
from wearscope.closed_loop.model.prediction import bootstrap_rms, pooled_rms
from wearscope.cycles.base import Reference
from wearscope.effects.time_delay import EFFECT as TIME_DELAY
from wearscope.errors import InputError, SimulationError
from wearscope.robots.model import RobotModel

#: Longest part of a test run that is simulated [s].
LONGEST = 60.0
_SEED = 13
_STAGES = ("before", "after")


def make_reference(run: PreparedRun) -> Reference:
    """Measured motion of a run, as filtered for regression, up to `LONGEST` seconds."""
    s = run.signals
    count = min(len(s.t), int(LONGEST * run.band.rate) + 1)
    # Recorded times jitter; the filters treat them as evenly spaced.
    t = s.t[0] + np.arange(count) / run.band.rate
    return Reference(t, s.q[:count], s.v[:count], s.a[:count])


def with_payload(model: RobotModel, prepared: Prepared, run: PreparedRun) -> RobotModel:
    """Model that carries the payload a run declares."""
    stated = state_payload(prepared.record_of(run).payload)
    return model if model.to_mapping().get("payload") == stated else model.replace(payload=stated)


def recorded_temperature(
    prepared: Prepared, run: PreparedRun, models: dict[str, RobotModel], count: int, start: int = 0
) -> np.ndarray:
    """Joint temperatures (count, n) of a run [deg C], from the sample `start` on.

    Raises
    ------
    InputError
        Where a model needs a temperature that was not recorded.
    """
    temperature = run.signals.temperature[start : start + count]
    for stage, model in models.items():
        for name in (entry.joint for entry in model.effects if "temperature" in entry.effect):
            if not np.isfinite(temperature[:, prepared.dataset.joints.index(name)]).all():
                raise InputError(
                    f"{run.file}: the model {stage} needs the temperature of joint '{name}', which this run "
                    "does not have; record it."
                )
    return temperature


def compare_forward(
    prepared: Prepared,
    models: dict[str, RobotModel],
    progress: Callable[[str], None] = lambda _: None,
) -> pd.DataFrame:
    """Simulate both models along every test run under the same controller.

    The controller follows the measured motion in two simulations. For the torque's error it feeds forward the
    torque of the model before, so that no measured torque enters. For the motion's error it feeds forward the
    measured motor torque, without the sensor errors that the model has: a correct model then stays on the
    measured motion. Torques are compared at the common bandwidth, on the rows that count; positions at all
    rows.

    Parameters
    ----------
    prepared : Prepared
    models : dict of str to RobotModel
        ``before`` and ``after``.
    progress : callable

    Returns
    -------
    DataFrame
        One row per joint, run (and ``all`` of them) and stage: `torque_rms` and `motion_rms`, the error
        against the measurement, with 95 % intervals (`_low`, `_high`), `seconds` simulated, `outcome`
        (``ok``, or why there is no simulation; errors are NaN then).
    """
    models = {stage: _move_back(model, prepared) for stage, model in models.items()}
    records: list[dict] = []
    pooled: dict[str, dict[str, list]] = {stage: {"torque": [], "motion": []} for stage in _STAGES}
    outcomes: dict[str, list[str]] = {stage: [] for stage in _STAGES}
    seconds: list[float] = []
    for run in prepared.runs_for("test"):
        reference = make_reference(run)
        simulated, keep, said = _simulate_run(prepared, run, models, reference)
        seconds.append(float(reference.t[-1] - reference.t[0]))
        measured = run.measured[: len(keep)]
        for stage in _STAGES:
            outcomes[stage].append(said[stage])
            parts: dict[str, list] = {"torque": [], "motion": []}
            if stage in simulated:
                tau, q = simulated[stage]
                parts["torque"] = [(measured - tau, keep)]
                parts["motion"] = [(q, np.ones_like(keep))]
                for kind in parts:
                    pooled[stage][kind] += parts[kind]
            records += _summarise(prepared, run.file, stage, parts, seconds[-1], said[stage])
            progress(f"forward simulation, {run.file}, model {stage}: {said[stage]}")
    for stage in _STAGES:
        failed = [said for said in outcomes[stage] if said != "ok"]
        told = "ok" if not failed else f"{len(failed)} of {len(outcomes[stage])} runs: {failed[0]}"
        records += _summarise(prepared, "all", stage, pooled[stage], sum(seconds), told)
    return pd.DataFrame(records)


def _move_back(model: RobotModel, prepared: Prepared) -> RobotModel:
    """The model with the delays that remain after the recordings' torque channels were moved."""
    if not prepared.dataset.delays:
        return model
    fields = model.to_mapping()
    for entry in fields["effects"]:
        if entry["effect"] == TIME_DELAY.name:
            entry["parameters"]["delay"] -= find_shift(
                prepared, prepared.dataset.joints.index(entry["joint"])
            )
    return model.replace(effects=fields["effects"])


def _simulate_run(
    prepared: Prepared, run: PreparedRun, models: dict[str, RobotModel], reference: Reference
) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], np.ndarray, dict[str, str]]:
    """Simulated torque and motion error by stage, mask of the rows that count, and outcome by stage."""
    # Imported here, since the simulator loads PyBullet and compiled code.
    from wearscope.simulation.study import simulate_forward

    count = len(reference.t)
    at = rows(run.band, count)
    length = len(range(count)[at])
    keep = run.keep[:length]
    short = replace(run, t=run.t[:length])
    simulated: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    said: dict[str, str] = {}

    def simulate(stage: str, carrier: RobotModel) -> tuple[np.ndarray, np.ndarray]:
        model = with_payload(carrier, prepared, run)
        conditions: dict[str, Any] = {
            "declared": with_payload(models["before"], prepared, run),
            "temperature": recorded_temperature(prepared, run, {stage: model}, count),
            "controller_temperature": mean_temperature(run),
        }
        torque = simulate_forward(model, reference, **conditions)
        motor = measured_motor_torque(model, run)[:count]
        motion = simulate_forward(model, reference, **conditions, feedforward=motor)
        return short.reduce(torque.tau), (motion.q - reference.q)[at]

    for stage in _STAGES:
        try:
            simulated[stage] = simulate(stage, models[stage])
            said[stage] = "ok"
        except SimulationError as error:
            stops = list(_find_stops(partial(simulate, stage), models["before"], models[stage]))
            said[stage] = f"failed: {error}" + (f" Without {' or '.join(stops)} it runs." if stops else "")
        except InputError as error:
            said[stage] = f"failed: {error}"
    return simulated, keep, said


def _find_stops(
    simulate: Callable[[RobotModel], Any], declared: RobotModel, model: RobotModel
) -> Iterator[str]:
    """Effects (with joints) that the declared model lacks and without which a model can be simulated."""
    known = {(one.effect, one.joint) for one in declared.effects}
    effects = model.to_mapping()["effects"]
    for entry in (one for one in effects if (one["effect"], one["joint"]) not in known):
        try:
            simulate(model.replace(effects=[one for one in effects if one is not entry]))
        except (SimulationError, InputError):
            continue
        yield f"{entry['effect'].replace('_', ' ')} at {entry['joint']}"


def measured_motor_torque(model: RobotModel, run: PreparedRun) -> np.ndarray:
    """Motor torque (N, n) that a model's sensors would record as the measured torque."""
    from wearscope.simulation.plant import build_plant

    plant = build_plant(model)
    t = run.signals.t
    late = [np.interp(t + delay, t, tau) for delay, tau in zip(plant.torque_delay, run.tau.T, strict=True)]
    return np.column_stack(late) / (1.0 + plant.torque_gain)


def mean_temperature(run: PreparedRun) -> np.ndarray:
    """Temperatures (n,) that the controller assumes [deg C]: a run's means, 50 where none is measured."""
    mean = run.signals.temperature.mean(axis=0)
    return np.where(np.isfinite(mean), mean, 50.0)


def _summarise(
    prepared: Prepared, file: str, stage: str, parts: dict[str, list], seconds: float, outcome: str
) -> list[dict]:
    """Rows of the table of `compare_forward` for one run and stage, one per joint."""
    n = prepared.n
    block = max(4, int(4 * prepared.band.torque))
    values = {}
    for kind, pairs in parts.items():
        empty = np.full(n, np.nan), np.full((2, n), np.nan)
        values[kind] = (pooled_rms(pairs), bootstrap_rms(pairs, block, _SEED)) if pairs else empty
    records = []
    for j, joint in enumerate(prepared.dataset.joints):
        record: dict = {"joint": joint, "run": file, "stage": stage}
        for kind, (size, interval) in values.items():
            record[f"{kind}_rms"] = size[j]
            record[f"{kind}_rms_low"], record[f"{kind}_rms_high"] = interval[:, j]
        records.append(record | {"seconds": seconds, "outcome": outcome})
    return records
