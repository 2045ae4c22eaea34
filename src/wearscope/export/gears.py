"""Compliance and lost motion of a gear in MJCF: a second joint about the motor's axis, held by springs.

The motor's joint carries the rotor; the joint ``<name>_gear`` turns the link against it. Its torque is a sum
of springs with dead bands (fixed tendons), as a gear hardens where its lost motion is taken up.
"""

import mujoco
import numpy as np

from wearscope.cycles.base import Reference
from wearscope.effects.base import Plant
from wearscope.export.holdings import Holdings
from wearscope.robots.dynamics import RigidBody
from wearscope.robots.spatial import Array
from wearscope.simulation.balance import deflection

#: Torques at which the springs meet the gear's law, over the torque that takes up the lost motion.
_KNOTS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0])
#: Damping ratio of the gear's springs with the inertia on its two sides.
_DAMPING = 0.05


def sum_springs(compliance: float, lost_motion: float, mesh_torque: float) -> list[tuple[float, float]]:
    """Stiffness and half dead band of springs that add up to a gear's torque over its deflection."""
    if lost_motion == 0.0:
        return [(1.0 / compliance, 0.0)]
    torque = _KNOTS * mesh_torque
    bands = deflection(torque, compliance, lost_motion, mesh_torque)
    slopes = np.append(np.diff(torque) / np.diff(bands), 1.0 / compliance)
    return list(zip(np.diff(slopes, prepend=0.0).tolist(), bands.tolist(), strict=True))


def add_gear(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, motor: mujoco.MjsJoint, held: Holdings, j: int
) -> None:
    """Give a link the joint of its gear, where the model has one."""
    if j not in held.gear:
        return
    joint = body.add_joint(name=f"{motor.name}_gear", axis=list(motor.axis), type=motor.type)
    compliance, _, _ = held.gear[j]
    for k, (stiffness, band) in enumerate(sum_springs(*held.gear[j])):
        spring = spec.add_tendon(name=f"{joint.name}_{k}", springlength=[-band, band])
        spring.stiffness = [stiffness, 0.0, 0.0]
        if k == 0:
            spring.damping = [2.0 * _DAMPING * float(np.sqrt(held.gear_inertia(j) / compliance)), 0.0, 0.0]
        spring.wrap_joint(joint.name, 1.0)


def follow_links(plant: Plant, body: RigidBody, motion: Reference) -> Reference:
    """Motion of the links, which lag the motors by what their load bends the gears."""
    flexible = np.flatnonzero((plant.compliance > 0.0) | (plant.lost_motion > 0.0))
    if not flexible.size:
        return motion
    load = body.inverse_dynamics(motion.q, motion.v, motion.a)
    q = motion.q.copy()
    for j in flexible:
        q[:, j] -= deflection(load[:, j], plant.compliance[j], plant.lost_motion[j], plant.mesh_torque[j])
    step = float(motion.t[1] - motion.t[0])
    v = motion.v + np.gradient(q - motion.q, step, axis=0)
    return Reference(motion.t, q, v, motion.a + np.gradient(v - motion.v, step, axis=0))


def find_gears(model: mujoco.MjModel, joints: list[str]) -> list[tuple[int, int, int]]:
    """Number of the joint, places in positions and speeds, of each gear."""
    names = {model.joint(k).name for k in range(model.njnt)}
    gears = [(j, model.joint(f"{name}_gear")) for j, name in enumerate(joints) if f"{name}_gear" in names]
    return [(j, int(one.qposadr[0]), int(one.dofadr[0])) for j, one in gears]


def place_gears(
    data: mujoco.MjData, gears: list[tuple[int, int, int]], row: tuple[Array, Array, Array]
) -> None:
    """Put the gears where the links lag the motors by `row`: position, speed and acceleration (n,)."""
    for j, q, v in gears:
        data.qpos[q], data.qvel[v], data.qacc[v] = (float(one[j]) for one in row)
