"""A planned run with its signals, and what recording it would show."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from wearscope.closed_loop.intake.dataset_fields import PayloadFields
from wearscope.closed_loop.intake.filtering import rows
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun, known_inertia
from wearscope.closed_loop.intake.saturation import keep_lasting, spread_out
from wearscope.closed_loop.intake.sources import is_carried, rigid_body_of
from wearscope.cycles.base import Reference
from wearscope.cycles.planned import PlannedMotion
from wearscope.effects.base import Signals

#: Length of a generated motion [s], pause between its moves [s].
SECONDS, DWELL = 30.0, 0.1
#: Smallest and largest number of runs of a plan: each held-out run needs a similar run among the others.
LEAST_RUNS, MOST_RUNS = 2, 6
#: A number of runs is promised if it tells the names apart with this probability.
POWER = 0.9
#: Temperature of a cold start [deg C].
COLD = 20.0


@dataclass(frozen=True)
class Plan:
    """A run that could be recorded.

    Attributes
    ----------
    cycle : str
        Name of the motion or test-cycle.
    motion : PlannedMotion or None
        The generated motion; None for a test-cycle.
    reference : Reference
        Motion at the rate of the filtered recordings.
    payload : PayloadFields or None
    temperature : float
        Temperature at the start [deg C]; NaN where it is not recorded.
    moving : ndarray (n,) of bool
        Joints that move; the others stay at home.
    """

    cycle: str
    motion: PlannedMotion | None
    reference: Reference
    payload: PayloadFields | None
    temperature: float
    moving: np.ndarray


@dataclass(frozen=True)
class NextMeasurement:
    """What to record next for one term.

    Attributes
    ----------
    joint : str
    names : list of str
        The named effect and its equivalents.
    plan : Plan
    runs : int
        Number of runs to record.
    power : float
        Probability that these runs tell the names apart.
    angle_before, angle_after : float
        Angle between the two names that are most alike, on the runs so far and with the new ones [deg].
    evidence_before, evidence_after : float
        Expected difference of their losses [residual variances].
    tried : int
        Number of plans compared.
    """

    joint: str
    names: list[str]
    plan: Plan
    runs: int
    power: float
    angle_before: float
    angle_after: float
    evidence_before: float
    evidence_after: float
    tried: int

    def to_mapping(self) -> dict[str, Any]:
        """Fields of ``verdict.json``."""
        plan = self.plan
        payload = None if plan.payload is None else {"mass": plan.payload.mass, "com": plan.payload.com}
        return {
            "joint": self.joint,
            "names": self.names,
            "cycle": plan.cycle,
            "seconds": float(plan.reference.t[-1]),
            "payload": payload,
            "start_temperature": float(plan.temperature) if np.isfinite(plan.temperature) else None,
            "runs": self.runs,
            "power": self.power,
            "angle_before_deg": self.angle_before,
            "angle_after_deg": self.angle_after,
            "evidence_before": self.evidence_before,
            "evidence_after": self.evidence_after,
            "plans_compared": self.tried,
        }


def list_payloads(prepared: Prepared) -> list[PayloadFields | None]:
    """Payloads that are at hand: those of the recordings, and no payload."""
    found: list[PayloadFields | None] = []
    for run in prepared.dataset.runs:
        if not any(_alike(run.payload, one) for one in found):
            found.append(run.payload)
    if None not in found:
        found.append(None)
    return found


def _alike(a: PayloadFields | None, b: PayloadFields | None) -> bool:
    if a is None or b is None:
        return a is b
    return a.mass == b.mass and list(a.com) == list(b.com)


def list_temperatures(prepared: Prepared) -> list[float]:
    """Start temperatures [deg C]: the recordings' mean, coldest and warmest, then cold; NaN without any.

    Each recording counts by the mean of the joints that record one.
    """
    warmth = [run.signals.temperature for run in prepared.runs_for("train")]
    means = [float(np.nanmean(own)) for own in warmth if np.isfinite(own).any()]
    if not means:
        return [float("nan")]
    values = [float(np.mean(means)), min(means), max(means), COLD]
    return list(dict.fromkeys(round(value, 1) for value in values))


#: A joint counts as at rest below this share of its highest recorded speed.
_REST = 0.01
#: File name of a planned run.
PLANNED = "planned"


def make_planned_run(
    prepared: Prepared, reference: Reference, payload: PayloadFields | None, temperature: float
) -> PreparedRun:
    """Signals of a planned motion, filtered as recorded ones are, without a torque.

    Parameters
    ----------
    prepared : Prepared
        The recordings, which give band, reversals and robot.
    reference : Reference
        Sampled at the band's rate.
    payload : PayloadFields or None
    temperature : float
        Temperature of all joints [deg C]; NaN where the recordings have none.
    """
    dataset, band = prepared.dataset, prepared.band
    body = rigid_body_of(prepared.urdf, dataset, payload)
    top = np.max([np.abs(run.signals.v).max(axis=0) for run in prepared.runs_for("train")], axis=0)
    slow = np.abs(reference.v) < _REST * np.maximum(top, 1e-9)
    width = int(0.5 * band.rate / band.torque)
    rest = keep_lasting(slow, width)
    sharp = np.where(rest, 0.0, np.sign(reference.v))
    sign = prepared.reversals.soften(reference.v, sharp)
    load = body.inverse_dynamics(reference.q, reference.v, reference.a)
    known = load + known_inertia(dataset) * reference.a
    signals = Signals(
        t=reference.t,
        q=reference.q,
        v=reference.v,
        a=reference.a,
        sign=sign,
        load=load,
        temperature=np.full_like(load, temperature),
        wear=np.zeros_like(load),
        rigid_body=body,
        torque=known,
        bandwidth=band.torque,
        carries=is_carried(dataset, payload),
    )
    at = rows(band, len(reference.t))
    keep = ~(slow | spread_out(rest, width))[at]
    return PreparedRun(PLANNED, "train", signals, known.copy(), known, band, keep, reference.t[at])
