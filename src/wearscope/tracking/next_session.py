"""The session to record next where wear cannot be told from temperature: which motion, how warm, what shows.

The machine is as it is, so that only its temperature can be chosen: one that the healthy sessions show. Each
plan is judged by the interval that a change of the joint's friction would have, with all that is not known
of the healthy machine, and of the reference's function of temperature there.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope import tables
from wearscope.closed_loop.diagnostics.next_measurement import hold_still, list_motions, planning_model
from wearscope.closed_loop.diagnostics.plan import DWELL, make_planned_run
from wearscope.closed_loop.intake.dataset import Dataset
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.cycles.base import Reference
from wearscope.cycles.planned import PlannedMotion, write_cycle
from wearscope.errors import InputError
from wearscope.tracking.changes import make_friction_change
from wearscope.tracking.inference import Estimate, estimate_change, make_sample
from wearscope.tracking.reference import Reference as Healthy
from wearscope.tracking.rows import make_rows, stack_rows
from wearscope.tracking.scatter import relative_change

#: Runs that are planned for a session.
RUNS = 2


@dataclass(frozen=True)
class NextSession:
    """What to record next for one joint.

    Attributes
    ----------
    joint : int
    motion : PlannedMotion
    seconds : float
    start_temperature : float
        [deg C]
    sees, sees_now : float
        Change of friction that would show, as a share of it, with the plan and in the session as it is.
    """

    joint: int
    motion: PlannedMotion
    seconds: float
    start_temperature: float
    sees: float
    sees_now: float

    def to_mapping(self, joints: Sequence[str]) -> dict[str, Any]:
        """As a session's record has it."""
        return {
            "joint": joints[self.joint],
            "cycle": self.motion.name,
            "motion": asdict(self.motion),
            "seconds": self.seconds,
            "runs": RUNS,
            "start_temperature": self.start_temperature,
            "sees": self.sees,
            "sees_now": self.sees_now,
        }


def plan_session(
    healthy: Healthy, dataset: Dataset, runs: list[PreparedRun], joint: int
) -> NextSession | None:
    """The plan by which the least change of a joint's friction would show; None where none helps.

    Parameters
    ----------
    healthy : Reference
        Machine that is compared with.
    dataset : Dataset
        Of the session.
    runs : list of PreparedRun
        Its runs, in the reference's frame.
    joint : int
        Whose temperature the reference records.
    """
    structure, frame = healthy.structure, healthy.structure.frame
    if not np.isfinite(structure.temperature[joint]):
        return None
    prepared = Prepared(
        dataset, frame.urdf, runs, frame.band, frame.moving, [], frame.reversals, frame.top_speed
    )
    model = planning_model(prepared, healthy.robot)
    step = 1.0 / frame.band.rate
    payload, usual = dataset.runs[0].payload, float(structure.temperature[joint])
    now = measure_width(healthy, runs, joint)

    def look(planned: PlannedMotion, built: Reference, temperature: float) -> NextSession:
        run = make_planned_run(prepared, built, payload, temperature)
        sees = measure_width(healthy, [run] * RUNS, joint)
        return NextSession(joint, planned, float(built.t[-1]), temperature, sees, now)

    found = []
    for motion in list_motions([int(j) for j in structure.moving], joint, seeds=1):
        planned = motion.plan_within(model)
        try:
            built = hold_still(planned.build(model, DWELL, step), frame.moving, model)
        except InputError:
            continue
        found.append((look(planned, built, usual), built))
    if not found:
        return None
    best, built = min(found, key=lambda one: one[0].sees)
    warmth = [float(x) for x in structure.warmth[:, joint]]
    best = min([best, *(look(best.motion, built, x) for x in warmth)], key=lambda one: one.sees)
    return best if best.sees < now else None


def measure_width(healthy: Healthy, runs: Sequence[PreparedRun], joint: int) -> float:
    """Change of a joint's friction, as a share of it, that would show in runs: twice half its interval."""
    structure, change = healthy.structure, make_friction_change(joint)
    made = [make_rows(structure, run) for run in runs]
    sample = make_sample(
        stack_rows(structure, [change], made), [change], healthy.belief, healthy.payload_prior
    )
    estimate = estimate_change(sample, change)
    if estimate is None:
        return np.inf
    inverse = np.linalg.pinv(sample.inner, rcond=1e-10, hermitian=True)
    expected = inverse @ (sample.clean.T @ sample.clean + sample.random) @ inverse
    size = float(structure.scales.friction[joint])
    value = np.array([size, size / float(structure.scales.speed[joint])])
    asked = Estimate(change, value, expected, estimate.shares, estimate.prior, 0.0, 1.0)
    return 2.0 * relative_change(asked, healthy.scatter)[1]


def tell_plan(plan: NextSession) -> str:
    """A plan in a sentence."""
    return (
        f"{RUNS} runs of the next measurement, started at {plan.start_temperature:.0f} °C, would show a "
        f"change of {100.0 * plan.sees:.0f} %."
    )


def write_plans(folder: Path, records: Sequence[dict[str, Any]], healthy: Healthy) -> None:
    """Write each joint's latest plan as a test-cycle, ``next_measurement_<k>.py``, and a table next to it."""
    for old in folder.glob("next_measurement_*"):
        old.unlink()
    joints, step = list(healthy.structure.joints), 1.0 / healthy.structure.frame.band.rate
    latest = {one["joint"]: one for record in records for one in record["next_measurement"]}
    for k, (joint, one) in enumerate(latest.items(), start=1):
        motion = PlannedMotion(**one["motion"])
        built = motion.build(healthy.robot, DWELL, step)
        columns = {"t": built.t}
        for j, name in enumerate(joints):
            for kind, values in (("q", built.q), ("qd", built.v), ("qdd", built.a)):
                columns[f"{kind}_{name}"] = values[:, j]
        tables.write_text(folder / f"next_measurement_{k}.csv", pd.DataFrame(columns).to_csv(index=False))
        reason = (
            f"Tells wear of joint {joint} from temperature, started at {one['start_temperature']:.0f} deg C."
        )
        tables.write_text(folder / f"next_measurement_{k}.py", write_cycle(motion, joints, reason))
        one["cycle_file"], one["table"] = f"next_measurement_{k}.py", f"next_measurement_{k}.csv"
