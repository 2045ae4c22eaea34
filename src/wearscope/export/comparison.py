"""Comparison of MuJoCo's torque along a motion with the model's own, and replays of a motion in each format.

In a replay MuJoCo gets the torque that the motion needs by the whole model, without feedback. It starts from
the motion again at regular intervals; its position after 0.1, 0.5 and 2 s is compared with the motion.
"""

from typing import Any

import mujoco
import numpy as np

from wearscope.cycles.base import Reference, required_torque
from wearscope.export.formats import find_gears, make_spec, place_gears
from wearscope.export.holdings import FORMATS, MJCF, Holdings, held_by, without_motors
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Array
from wearscope.simulation.balance import deflection
from wearscope.simulation.plant import build_plant

#: A joint moves above this share of its highest speed. There MuJoCo's friction, a soft constraint, has
#: reached its level.
MOVING = 0.01
#: Number of steps of the passive motors' states per sample of a motion.
_STEPS = 4


def inverse_dynamics(
    spec: mujoco.MjSpec,
    joints: list[str],
    reference: Reference,
    friction: bool = True,
    links: Reference | None = None,
) -> Array:
    """MuJoCo's inverse dynamics (N, n) along a motion, with or without Coulomb friction.

    Where the model has gears that yield, `links` is the motion of the links.
    """
    model = spec.compile()
    # Planned motions keep to the limits, but MuJoCo's soft limits push back already a little before them.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    if not friction:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
    data = mujoco.MjData(model)
    place = [model.joint(name) for name in joints]
    q = [int(joint.qposadr[0]) for joint in place]
    v = [int(joint.dofadr[0]) for joint in place]
    model.opt.timestep = float(reference.t[1] - reference.t[0]) / _STEPS
    torque = np.empty(reference.q.shape)
    gears = find_gears(model, joints) if links is not None else []
    lag = [getattr(links or reference, key) - getattr(reference, key) for key in ("q", "v", "a")]
    for row in range(len(reference.t)):
        for _ in range(_STEPS if model.na else 1):
            # In these steps the passive motors' bristles follow the motion.
            data.qpos[q], data.qvel[v] = reference.q[row], reference.v[row]
            place_gears(data, gears, (lag[0][row], lag[1][row], lag[2][row]))
            mujoco.mj_step(model, data)
        passive = data.qfrc_actuator[v].copy()
        data.qpos[q], data.qvel[v], data.qacc[v] = reference.q[row], reference.v[row], reference.a[row]
        place_gears(data, gears, (lag[0][row], lag[1][row], lag[2][row]))
        mujoco.mj_inverse(model, data)
        torque[row] = data.qfrc_inverse[v] - passive
    return torque


def whole_torque(model: RobotModel, held: Holdings, reference: Reference, temperature: float) -> Array:
    """Torque (N, n) that a motion needs by the whole model, whatever a format can hold [N m or N]."""
    corrected = model.rigid_body().inertial_regressor(reference.q, reference.v, reference.a)
    links, body = link_motion(model, held, reference), held.body
    lag = body.inverse_dynamics(links.q, links.v, links.a)
    lag -= body.inverse_dynamics(reference.q, reference.v, reference.a)
    return required_torque(reference, model, temperature, 0.0, 1.0) + corrected @ held.corrected.ravel() + lag


def link_motion(model: RobotModel, held: Holdings, reference: Reference) -> Reference:
    """Motion of the links, which lag the motors since their load bends the gears."""
    plant = build_plant(model)
    flexible = np.flatnonzero((plant.compliance > 0.0) | (plant.lost_motion > 0.0))
    if not flexible.size:
        return reference
    load = held.body.inverse_dynamics(reference.q, reference.v, reference.a)
    q = reference.q.copy()
    for j in flexible:
        q[:, j] -= deflection(load[:, j], plant.compliance[j], plant.lost_motion[j], plant.mesh_torque[j])
    step = float(reference.t[1] - reference.t[0])
    v = reference.v + np.gradient(q - reference.q, step, axis=0)
    return Reference(reference.t, q, v, reference.a + np.gradient(v - reference.v, step, axis=0))


def compare(model: RobotModel, held: Holdings, reference: Reference, temperature: float) -> dict[str, Array]:
    """Compare MuJoCo's inverse dynamics along a motion with the model's.

    Parameters
    ----------
    model : RobotModel
    held : Holdings
    reference : Reference
    temperature : float
        [deg C]

    Returns
    -------
    dict of str to ndarray (n,)
        RMS by joint [N m or N]. `torque_rms`: the model's torque. `difference_without_coulomb`: MuJoCo's
        torque less that of the exported numbers, both without Coulomb friction. `difference_where_moving` and
        `difference`: the same with Coulomb friction, where the joint moves and at all samples, since MuJoCo's
        friction is a soft constraint. `not_held_where_moving`: MuJoCo's torque less the whole model's, which
        is what the format cannot hold.
    """
    links = link_motion(model, held, reference)
    theirs = inverse_dynamics(make_spec(model, held), model.joints, reference, links=links)
    load = held.body.inverse_dynamics(reference.q, reference.v, reference.a)
    behind = held.body.inverse_dynamics(links.q, links.v, links.a)
    own = held.torque(reference.v, reference.a, reference.q, behind)
    whole = whole_torque(model, held, reference, temperature)
    bare = without_motors(held)
    smooth = inverse_dynamics(make_spec(model, bare), model.joints, reference, friction=False)
    smooth = smooth - bare.torque(reference.v, reference.a, reference.q, load)
    smooth += held.friction * np.sign(reference.v)
    moving = np.abs(reference.v) > MOVING * np.abs(reference.v).max(axis=0)

    def rms(x: Array, where: Array | None = None) -> Array:
        if where is None:
            return np.sqrt(np.mean(x**2, axis=0))
        count = np.maximum(where.sum(axis=0), 1)
        return np.sqrt(np.sum(np.where(where, x, 0.0) ** 2, axis=0) / count)

    return {
        "torque_rms": rms(whole),
        "difference_without_coulomb": rms(smooth),
        "difference_where_moving": rms(theirs - own, moving),
        "difference": rms(theirs - own),
        "not_held_where_moving": rms(theirs - whole, moving),
    }


#: Times after which the position is compared [s]; time between two starts [s]; time before a start in which
#: bristles and gears follow the motion [s].
HORIZONS, _EVERY, _WARM = (0.1, 0.5, 2.0), 0.5, 0.3
#: MuJoCo's time step [s].
STEP = 1e-3
WITHOUT = f"{MJCF} without passive motors"


def compare_replays(
    model: RobotModel, held: Holdings, reference: Reference, temperature: float
) -> dict[str, dict[str, Any]]:
    """Differences of each format's replay, by format and joint; for the parameters see `compare`.

    Returns
    -------
    dict
        By format, and for MJCF without its passive motors, by joint: `torque`, RMS difference along the
        motion [N m or N], and `position`, median absolute difference by time [rad or m].
    """
    whole = whole_torque(model, held, reference, temperature)
    links = link_motion(model, held, reference)
    formats = {format: held_by(held, format) for format in FORMATS} | {WITHOUT: without_motors(held)}
    found: dict[str, dict[str, Any]] = {}
    for format, one in formats.items():
        spec = make_spec(model, one)
        own = inverse_dynamics(spec, model.joints, reference, links=links)
        torque = np.sqrt(np.mean((own - whole) ** 2, axis=0))
        position = replay(spec, model.joints, reference, whole, links)
        found[format] = {
            joint: {
                "torque": float(torque[j]),
                "position": {f"{s:g}": float(position[k, j]) for k, s in enumerate(HORIZONS)},
            }
            for j, joint in enumerate(model.joints)
        }
    return found


def replay(
    spec: mujoco.MjSpec,
    joints: list[str],
    reference: Reference,
    torque: Array,
    links: Reference | None = None,
) -> Array:
    """Median position error (3, n) after each of `HORIZONS` under a torque (N, n) along a motion.

    Where the model has gears that yield, `links` is the motion of the links, from which they start.
    """
    model = spec.compile()
    model.opt.timestep = STEP
    data = mujoco.MjData(model)
    q = [int(model.joint(name).qposadr[0]) for name in joints]
    v = [int(model.joint(name).dofadr[0]) for name in joints]
    t = np.arange(reference.t[0], reference.t[-1], STEP)
    gears, behind = find_gears(model, joints), links or reference
    place, speed, drive, lag, slip = (
        np.column_stack([np.interp(t, reference.t, column) for column in x.T])
        for x in (reference.q, reference.v, torque, behind.q - reference.q, behind.v - reference.v)
    )
    ends = [round(one / STEP) for one in HORIZONS]
    warm = round(_WARM / STEP)
    errors = []
    for start in range(warm, len(t) - ends[-1], round(_EVERY / STEP)):
        mujoco.mj_resetData(model, data)
        place_gears(data, gears, (lag[start - warm], slip[start - warm], 0.0 * slip[0]))
        for row in range(start - warm, start):
            data.qpos[q], data.qvel[v], data.qfrc_applied[v] = place[row], speed[row], drive[row]
            mujoco.mj_step(model, data)
        data.qpos[q], data.qvel[v] = place[start], speed[start]
        reached = []
        for row in range(start, start + ends[-1]):
            data.qfrc_applied[v] = drive[row]
            mujoco.mj_step(model, data)
            if row + 1 - start in ends:
                reached.append(np.abs(data.qpos[q] - place[row + 1]))
        data.qfrc_applied[v] = 0.0
        errors.append(reached)
    return np.asarray(np.median(np.array(errors), axis=0))
