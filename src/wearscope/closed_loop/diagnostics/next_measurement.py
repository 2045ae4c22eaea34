"""The next measurement: the motion, payload and temperature that tell apart what the runs so far cannot."""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from wearscope.closed_loop.diagnostics.outcome import Outcome
from wearscope.closed_loop.diagnostics.plan import (
    DWELL,
    LEAST_RUNS,
    MOST_RUNS,
    POWER,
    SECONDS,
    NextMeasurement,
    Plan,
    list_payloads,
    list_temperatures,
    make_planned_run,
)
from wearscope.closed_loop.diagnostics.rivalry import Rivalry, Sums, list_names, look_along
from wearscope.closed_loop.intake.dataset_fields import PayloadFields, state_payload
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.cycles.base import Reference, check_reference, list_cycles, load_cycle
from wearscope.cycles.planned import PlannedMotion, write_cycle
from wearscope.errors import InputError
from wearscope.robots.model import RobotModel
from wearscope.robots.urdf import OPEN_LIMIT, parse_urdf
from wearscope.storage import tables

#: Range of planned motions over the recorded range, about its middle and within the URDF's limits; speed of
#: planned motions over the recorded speed.
STRETCH, FASTER = 2.0, 1.5
#: Number of runs of each plan that is assumed when plans are compared.
_COMPARED = 3.0
#: Number of motions that are compared with every payload and temperature.
_REFINED = 3
#: Number of draws of each kind of random motion.
_SEEDS = 3


def planning_model(prepared: Prepared, model: RobotModel) -> RobotModel:
    """Model with the limits that a planned motion may use.

    The range is the recorded one stretched by `STRETCH` about its middle, within the URDF's position limits.
    Speed and acceleration are `FASTER` times the recorded ones, the speed within the URDF's limit if it
    states one.
    """
    joints = {joint.name: joint for joint in parse_urdf(prepared.dataset.urdf).joints}
    drive = model.drive.model_dump(exclude_none=True)
    lower, upper = np.array(model.lower), np.array(model.upper)
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    low, high = middle - STRETCH * half, middle + STRETCH * half
    # The model's limits are the recorded values with a margin of 10 %.
    recorded = np.array(drive["speed_limit"]) / 1.1
    speed = FASTER * recorded
    for j, name in enumerate(model.joints):
        stated = joints[name]
        speed[j] = min(speed[j], max(stated.velocity, recorded[j]))
        if -OPEN_LIMIT < stated.lower < stated.upper < OPEN_LIMIT:
            low[j] = min(max(low[j], stated.lower), lower[j])
            high[j] = max(min(high[j], stated.upper), upper[j])
    still = half < 1e-6
    low[still], high[still] = lower[still] - 1e-6, upper[still] + 1e-6
    drive["speed_limit"] = speed.tolist()
    for key in ("acceleration_limit", "jerk_limit"):
        drive[key] = (FASTER * np.array(drive[key]) / 1.1).tolist()
    home = np.clip(model.home_posture, low + 1e-9, high - 1e-9)
    return model.replace(drive=drive, lower=low.tolist(), upper=high.tolist(), home=home.tolist())


def list_motions(joints: Sequence[int], joint: int) -> list[PlannedMotion]:
    """Motions to compare for a term at a joint; `joints` are those that move in the recordings."""
    made = [
        PlannedMotion(kind, None, seed, pace, size, SECONDS)
        for kind in ("fourier", "points")
        for seed in range(_SEEDS)
        for pace, size in ((1.0, 1.0), (0.4, 1.0), (1.0, 0.4))
    ]
    for kind in ("sweeps", "postures", "strokes"):
        for pace in (1.0, 0.3):
            made += [
                PlannedMotion(kind, joint, seed, pace, 1.0, SECONDS)
                for seed in range(1 + (kind == "postures"))
            ]
    if len(joints) > 1:
        made += [PlannedMotion("sweeps", None, 0, pace, 1.0, SECONDS) for pace in (1.0, 0.3)]
    return made


def list_plans(
    prepared: Prepared,
    model: RobotModel,
    joints: Sequence[int],
    payloads: Sequence[PayloadFields | None],
    temperatures: list[float],
    chosen: Collection[str] | None = None,
) -> Iterator[Plan]:
    """Plans that the robot can follow.

    Parameters
    ----------
    prepared : Prepared
    model : RobotModel
        From `planning_model`.
    joints : sequence of int
        Joints of the terms that have rivals.
    payloads : sequence of PayloadFields or None
    temperatures : list of float
        Temperatures at the start [deg C].
    chosen : collection of str, optional
        Names of the generated motions and test-cycles to plan; all by default.
    """
    step = 1.0 / prepared.band.rate
    moving = [int(j) for j in np.flatnonzero(prepared.moving)]
    motions = dict.fromkeys(motion for joint in joints for motion in list_motions(moving, joint))
    built: list[tuple[str, PlannedMotion | None, Callable[[RobotModel, float, float], Reference]]] = [
        (motion.name, motion, motion.build) for motion in (one.plan_within(model) for one in motions)
    ]
    for name in list_cycles():
        cycle = load_cycle(name)
        built.append((cycle.name, None, cycle.build))
    for name, motion, build in built:
        planned = len(temperatures) and (chosen is None or name in chosen)
        for payload in payloads if planned else ():
            carrying = model.replace(payload=state_payload(payload))
            try:
                reference = build(carrying, DWELL, step)
                reference = hold_still(reference, prepared.moving, carrying)
                check_reference(reference, carrying, name, temperatures[:1], 0.0, 0.0)
            except InputError:
                continue
            for temperature in temperatures:
                yield Plan(name, motion, reference, payload, temperature, prepared.moving)


def hold_still(reference: Reference, moving: np.ndarray, model: RobotModel) -> Reference:
    """Motion in which joints that never moved in the recordings stay at home; `moving` (n,) of bool."""
    still = ~moving
    if not still.any():
        return reference
    q, v, a = (np.array(x) for x in (reference.q, reference.v, reference.a))
    q[:, still], v[:, still], a[:, still] = model.home_posture[still], 0.0, 0.0
    return Reference(reference.t, q, v, a)


def plan_measurements(
    diagnosis: Outcome, progress: Callable[[str], None] = lambda _: None
) -> list[NextMeasurement]:
    """For each term that has equivalents, the run that tells them apart best.

    Every plan is judged by the pair of the named effect and another name that has the least expected
    evidence, whichever of the two is the truth (Atkinson and Fedorov, Biometrika 62, 1975). The runs so far
    and the new ones count together, and all other terms are refitted. The number of runs is the least that
    tells the names apart with probability `POWER`, `MOST_RUNS` at most.

    Parameters
    ----------
    diagnosis : Outcome
    progress : callable

    """
    prepared, after = diagnosis.prepared, diagnosis.proposed
    first = len(after.entries) - len(diagnosis.attributions)
    model = planning_model(prepared, diagnosis.models["before"])

    comparisons: list[_Comparison] = []
    for number, named in enumerate(diagnosis.attributions):
        if not named.equivalent:
            continue
        names = list_names(after, first + number, named.equivalent, list(diagnosis.problem.effects))
        rivalry = Rivalry(after, first + number, names)
        joint = named.term.joint
        progress(
            f"what tells {' from '.join(name.effect.name for name in names)} at "
            f"{prepared.dataset.joints[joint]}"
        )
        comparisons.append(_Comparison(rivalry, joint))
    payloads, temperatures = list_payloads(prepared), list_temperatures(prepared)
    if joints := [one.joint for one in comparisons]:
        _compare(comparisons, prepared, list_plans(prepared, model, joints, payloads[:1], temperatures[:1]))
    for one in comparisons:
        likeliest = sorted(one.values, key=lambda name: -one.values[name])[:_REFINED]
        starts = temperatures if one.is_warm else temperatures[:1]
        for others in ((payloads[1:], starts), (payloads[:1], starts[1:])):
            _compare([one], prepared, list_plans(prepared, model, [one.joint], *others, likeliest))
    return [_promise(one, prepared, *one.best) for one in comparisons if one.best is not None]


@dataclass
class _Comparison:
    """Names that a run may tell apart, and the best plan so far.

    All motions are compared with one payload and temperature, the `_REFINED` best ones with all of them.

    Attributes
    ----------
    rivalry : Rivalry
    joint : int
    count : int
        Number of plans compared.
    values : dict of str to float
        By motion, the standard errors by which its runs tell the names apart.
    best : tuple of (Plan, Sums) or None
    most : float
        The same standard errors of the best plan.
    """

    rivalry: Rivalry
    joint: int
    count: int = 0
    values: dict[str, float] = field(default_factory=dict)
    best: tuple[Plan, Sums] | None = None
    most: float = -np.inf

    @property
    def is_warm(self) -> bool:
        """Whether a name depends on temperature or time."""
        signals = {signal for name in self.rivalry.names for signal in name.effect.depends_on}
        return any("temp" in signal or signal == "t" for signal in signals)

    def compare(self, plan: Plan, sums: Sums) -> None:
        """Keep a plan if it tells the names apart better than the best one so far."""
        self.count += 1
        both = self.rivalry.recorded.add(sums, _COMPARED)
        value = self.values[plan.cycle] = self.rivalry.score(both, self.rivalry.worst(both))
        if self.best is None or value > self.most:
            self.most, self.best = value, (plan, sums)


def _compare(comparisons: Sequence[_Comparison], prepared: Prepared, plans: Iterator[Plan]) -> None:
    """Compare plans for every term that they are meant for; each plan is evaluated once."""
    model = comparisons[0].rivalry.model
    effects = [name.effect for one in comparisons for name in one.rivalry.names]
    for plan in plans:
        run = make_planned_run(prepared, plan.reference, plan.payload, plan.temperature)
        if len(run.t) < 40:
            continue
        seen = look_along(model, run, effects)
        for one in comparisons:
            if plan.motion is None or plan.motion.joint in (None, one.joint):
                one.compare(plan, one.rivalry.sum_along([seen]))


def _promise(comparison: _Comparison, prepared: Prepared, plan: Plan, sums: Sums) -> NextMeasurement:
    """Measurement with the fewest runs of a plan that tell the names apart with probability `POWER`."""
    rivalry, joint = comparison.rivalry, prepared.dataset.joints[comparison.joint]
    before = rivalry.worst(rivalry.recorded)
    runs, power, after = LEAST_RUNS, 0.0, before
    for runs in range(LEAST_RUNS, MOST_RUNS + 1):
        both = rivalry.recorded.add(sums, float(runs))
        after = rivalry.worst(both)
        power = float(stats.norm.cdf(rivalry.score(both, after)))
        if power >= POWER:
            break
    return NextMeasurement(
        joint, [name.effect.name for name in rivalry.names], plan, runs, power, before.angle, after.angle,
        before.evidence, after.evidence, comparison.count,
    )  # fmt: skip


def write_measurements(
    folder: Path, found: Sequence[NextMeasurement], joints: list[str]
) -> list[dict[str, Any]]:
    """Write each promised plan as a test-cycle (where it was generated) and a table; return all entries.

    ``next_measurement_<k>.py`` defines ``CYCLE``; ``next_measurement_<k>.csv`` has t [s] and by joint
    position, speed and acceleration, for a controller.
    """
    entries = []
    for old in folder.glob("next_measurement_*"):
        old.unlink()
    for k, one in enumerate(found, start=1):
        entry = one.to_mapping()
        entries.append(entry)
        if one.power < POWER:
            continue
        stem = f"next_measurement_{k}"
        reference = one.plan.reference
        columns = {"t": reference.t}
        for j, joint in enumerate(joints):
            for kind, values in (("q", reference.q), ("qd", reference.v), ("qdd", reference.a)):
                columns[f"{kind}_{joint}"] = values[:, j]
        tables.write_text(folder / f"{stem}.csv", pd.DataFrame(columns).to_csv(index=False))
        entry["table"] = f"{stem}.csv"
        if one.plan.motion is not None:
            reason = f"Tells {' from '.join(one.names)} at joint {one.joint}."
            tables.write_text(folder / f"{stem}.py", write_cycle(one.plan.motion, joints, reason))
            entry["cycle_file"] = f"{stem}.py"
    return entries
