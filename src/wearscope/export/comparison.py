"""MuJoCo's torque along a motion beside the model's own."""

from dataclasses import dataclass

import mujoco
import numpy as np

from wearscope.cycles.base import Reference, required_torque
from wearscope.export.holdings import Holdings
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Array

#: A joint moves above this share of its highest speed: there MuJoCo's friction, which it solves for as a soft
#: constraint, has reached its level.
MOVING = 0.01


@dataclass(frozen=True)
class Comparison:
    """Differences by joint (n,), RMS [N m or N], along a motion.

    Attributes
    ----------
    torque : ndarray
        RMS of the model's torque.
    smooth : ndarray
        MuJoCo less what it was given to hold, both without Coulomb friction.
    held_moving, held : ndarray
        The same with it, where the joint moves, and at all instants: MuJoCo's friction is a soft constraint.
    left : ndarray
        MuJoCo less the whole model, where the joint moves: what the format cannot hold.
    """

    torque: Array
    smooth: Array
    held_moving: Array
    held: Array
    left: Array


def inverse_dynamics(
    spec: mujoco.MjSpec, joints: list[str], reference: Reference, friction: bool = True
) -> Array:
    """MuJoCo's inverse dynamics (N, n) along a motion, with or without Coulomb friction."""
    model = spec.compile()
    # Planned motions keep to the limits; MuJoCo's push back softly from a little before them.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    if not friction:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
    data = mujoco.MjData(model)
    place = [model.joint(name) for name in joints]
    q = [int(joint.qposadr[0]) for joint in place]
    v = [int(joint.dofadr[0]) for joint in place]
    torque = np.empty(reference.q.shape)
    for row in range(len(reference.t)):
        data.qpos[q], data.qvel[v], data.qacc[v] = reference.q[row], reference.v[row], reference.a[row]
        mujoco.mj_inverse(model, data)
        torque[row] = data.qfrc_inverse[v]
    return torque


def compare(
    model: RobotModel, held: Holdings, spec: mujoco.MjSpec, reference: Reference, temperature: float
) -> Comparison:
    """Compare MuJoCo's inverse dynamics along a motion with the model's.

    Parameters
    ----------
    model : RobotModel
    held : Holdings
    spec : MjSpec
    reference : Reference
    temperature : float
        [deg C]
    """
    theirs = inverse_dynamics(spec, model.joints, reference)
    load = held.body.inverse_dynamics(reference.q, reference.v, reference.a)
    own = held.torque(reference.v, reference.a, reference.q, load)
    whole = required_torque(reference, model, temperature, 0.0, 1.0)
    links = model.rigid_body()
    whole += links.inertial_regressor(reference.q, reference.v, reference.a) @ held.corrected.ravel()
    smooth = inverse_dynamics(spec, model.joints, reference, friction=False)
    smooth = smooth - own + held.friction * np.sign(reference.v)
    moving = np.abs(reference.v) > MOVING * np.abs(reference.v).max(axis=0)

    def rms(x: Array, where: Array | None = None) -> Array:
        if where is None:
            return np.sqrt(np.mean(x**2, axis=0))
        count = np.maximum(where.sum(axis=0), 1)
        return np.sqrt(np.sum(np.where(where, x, 0.0) ** 2, axis=0) / count)

    return Comparison(
        rms(whole), rms(smooth), rms(theirs - own, moving), rms(theirs - own), rms(theirs - whole, moving)
    )
