"""What MuJoCo has for a joint beyond plain friction: passive motors, and gears that yield.

A passive ``dcmotor`` has friction by LuGre's law, and a wave over the position.
The law's steady friction falls with the square of the speed, as level exp(-(v/speed)^2). A fall with another
exponent up to 2 is a sum of such falls, each a motor of its own.

A gear with compliance or lost motion is a second joint about the motor's axis, held by springs. The motor's
joint carries the rotor; the joint ``<name>_gear`` turns the link against it. Its torque is a sum of springs
with dead bands (fixed tendons), as a gear hardens where its lost motion is taken up.

Source: Canudas de Wit et al. 1995, IEEE T. Automatic Control 40(3); MuJoCo 3.12, XML reference, ``dcmotor``.
"""

import mujoco
import numpy as np
from scipy.optimize import nnls

from wearscope.cycles.base import Reference
from wearscope.effects.base import Plant
from wearscope.export.holdings import FASTEST, Holdings
from wearscope.robots.dynamics import RigidBody
from wearscope.robots.spatial import Array
from wearscope.simulation.balance import deflection

#: Torques at which the springs meet the gear's law, over the torque that takes up the lost motion.
_KNOTS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0])
#: Damping ratio of the gear's springs with the inertia on its two sides.
_GEAR_DAMPING = 0.05


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
            critical = 2.0 * float(np.sqrt(held.gear_inertia(j) / compliance))
            spring.damping = [_GEAR_DAMPING * critical, 0.0, 0.0]
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


#: Speeds of the falls in a sum, over the speed of the fall that they replace; smallest weight that is kept,
#: as a share of all.
_SPEEDS, _LEAST = 2.0 ** np.arange(-5.0, 3.1, 0.5), 0.01
#: Share of a fall's level that remains in fast motion where the joint has no Coulomb friction: LuGre's law
#: needs some.
_FLOOR = 0.01
#: Damping ratio of the bristles with the joint's inertia. Bristles that follow Dahl's law, where the model
#: knows the displacement, have no damping.
_DAMPING = 0.05
#: Electrical resistance, so high that the motor carries no current, and its motor constant.
_OPEN, _CONSTANT = 1e9, [1.0, 0.0]


def sum_falls(exponent: float) -> list[tuple[float, float]]:
    """Weights and speeds of falls with the square that add up to exp(-x^exponent); one where it is near 2."""
    if exponent > 1.9:
        return [(1.0, 1.0)]
    x = np.concatenate([np.linspace(0.0, 1.0, 60), np.linspace(1.0, 6.0, 60)])
    weights, _ = nnls(np.exp(-((x[:, None] / _SPEEDS) ** 2)), np.exp(-(x**exponent)))
    kept = weights > _LEAST * weights.sum()
    shares = weights[kept] / weights[kept].sum()
    return list(zip(shares.tolist(), _SPEEDS[kept].tolist(), strict=True))


def add_passive_motors(spec: mujoco.MjSpec, name: str, held: Holdings, j: int) -> float:
    """Give a joint the motors that its friction and its waves need; its Coulomb friction that is left.

    Parameters
    ----------
    spec : MjSpec
    name : str
        Of the joint.
    held : Holdings
    j : int
        Number of the joint.
    """
    for k, (cosine, sine, wavenumber) in enumerate(held.wave.get(j, [])):
        size, phase = float(np.hypot(cosine, sine)), float(np.arctan2(-cosine, -sine))
        _add(spec, f"{name}_wave_{k}", name, cogging=[size, float(wavenumber), phase])
    falling, presliding = held.falling.get(j, []), held.presliding.get(j, [])
    if not falling and not presliding:
        return float(held.friction[j])
    level = float(held.friction[j])
    if presliding:
        level = sum(one for one, _ in presliding)
    parts = [
        (share, share * fall, speed * scale)
        for fall, speed, exponent in falling
        for share, scale in sum_falls(exponent)
    ] or [(1.0, 0.0, 1.0)]
    whole = sum(share for share, _, _ in parts)
    inertia = float(held.armature[j]) + float(held.body.mass_matrix(np.zeros(len(held.friction)))[j, j])
    levels = [max(level * share / whole, _FLOOR * fall) for share, fall, _ in parts]
    at_rest = sum(levels) + sum(fall for _, fall, _ in parts)
    displacement = presliding[0][1] if presliding else at_rest / (inertia * FASTEST**2)
    ratio = 0.0 if presliding else _DAMPING
    for k, (coulomb, (_, fall, speed)) in enumerate(zip(levels, parts, strict=True)):
        stiffness = (coulomb + fall) / displacement
        damping = 2.0 * ratio * np.sqrt(stiffness * inertia)
        lugre = [stiffness, damping, coulomb, coulomb + fall, speed]
        _add(spec, f"{name}_friction_{k}", name, lugre=[float(one) for one in lugre])
    return max(float(held.friction[j]) - level, 0.0)


def _add(spec: mujoco.MjSpec, name: str, joint: str, **law: list[float]) -> None:
    motor = spec.add_actuator(name=name, target=joint)
    motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
    motor.set_to_dcmotor(_CONSTANT, _OPEN, ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE), **law)
