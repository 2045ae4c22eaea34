"""A run that has not been recorded yet, as regression would see it."""

from dataclasses import replace

import numpy as np

from wearscope.closed_loop.intake.dataset_fields import PayloadFields
from wearscope.closed_loop.intake.filtering import rows
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun, known_inertia
from wearscope.closed_loop.intake.saturation import keep_lasting, spread_out
from wearscope.closed_loop.intake.sources import is_carried
from wearscope.cycles.base import Reference
from wearscope.effects.base import Signals
from wearscope.robots.dynamics import Payload, RigidBody

#: A joint counts as at rest below this share of its highest recorded speed.
_REST = 0.01
#: File that a planned run is given.
PLANNED = "planned"


def make_planned_run(
    prepared: Prepared, reference: Reference, payload: PayloadFields | None, temperature: float
) -> PreparedRun:
    """Signals of a planned motion, filtered as recorded ones are, without a torque.

    Parameters
    ----------
    prepared : Prepared
        Of the recordings: band, widths of the friction's reversal, robot.
    reference : Reference
        Sampled at the band's rate.
    payload : PayloadFields or None
    temperature : float
        Of all joints [deg C]; NaN where the recordings have none.
    """
    dataset, band = prepared.dataset, prepared.band
    carried = None
    if payload is not None:
        x, y, z = payload.com
        carried = Payload(payload.mass, (x, y, z))
    body = RigidBody(prepared.urdf, dataset.joints, tuple(dataset.fields.robot.gravity), carried)
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
    empty = np.zeros((len(range(len(reference.t))[at]), prepared.n))
    return PreparedRun(PLANNED, "train", signals, known.copy(), known, band, keep, empty, reference.t[at])


def with_runs(prepared: Prepared, runs: list[PreparedRun]) -> Prepared:
    """The same data set with other runs."""
    return replace(prepared, runs=runs)
