"""A model as URDF and as MJCF text.

Beyond plain friction, a joint in MuJoCo may have passive motors and a gear that yields. A passive ``dcmotor``
has friction by LuGre's law, and a wave over the position. The law's steady friction falls with the square of
the speed, as level exp(-(v/speed)^2). A fall with another exponent up to 2 is a sum of such falls, each a
motor of its own.

A gear with compliance or lost motion is a second joint about the motor's axis, held by springs. The motor's
joint carries the rotor; the joint ``<name>_gear`` turns the link against it. Its torque is a sum of springs
with dead bands (fixed tendons), as a gear hardens where its lost motion is taken up.

Source: Canudas de Wit et al. 1995, IEEE T. Automatic Control 40(3); MuJoCo 3.12, XML reference, ``dcmotor``.
"""

import json

import mujoco
import numpy as np
from scipy.optimize import nnls

from wearscope.export.holdings import FASTEST, Holdings
from wearscope.robots import urdf
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Array, Inertia
from wearscope.robots.urdf import OPEN_LIMIT, Joint, Link, Pose, Tree, make_link, parse_urdf
from wearscope.simulation.balance import deflection

#: Torques at which the sum of springs equals the gear's law, over the torque that takes up the lost motion.
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
    """Add the joint of a link's gear with its springs, where the model has a gear that yields."""
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


def find_gears(model: mujoco.MjModel, joints: list[str]) -> list[tuple[int, int, int]]:
    """For each gear: index of its joint, and its indices in MuJoCo's positions and speeds."""
    names = {model.joint(k).name for k in range(model.njnt)}
    gears = [(j, model.joint(f"{name}_gear")) for j, name in enumerate(joints) if f"{name}_gear" in names]
    return [(j, int(one.qposadr[0]), int(one.dofadr[0])) for j, one in gears]


def place_gears(
    data: mujoco.MjData, gears: list[tuple[int, int, int]], row: tuple[Array, Array, Array]
) -> None:
    """Set the gears' state to `row`: how links lag motors in position, speed and acceleration, each (n,)."""
    for j, q, v in gears:
        data.qpos[q], data.qvel[v], data.qacc[v] = (float(one[j]) for one in row)


#: Speeds of the falls in a sum, over the speed of the fall that they replace; smallest weight that is kept,
#: as a share of the sum of the weights.
_SPEEDS, _LEAST_SHARE = 2.0 ** np.arange(-5.0, 3.1, 0.5), 0.01
#: Share of a fall's level that remains in fast motion where the joint has no Coulomb friction: LuGre's law
#: needs some.
_FLOOR = 0.01
#: Damping ratio of the bristles with the joint's inertia. Bristles that follow Dahl's law, where the model
#: knows the displacement, have no damping.
_DAMPING = 0.05
#: Electrical resistance, so high that the motor carries no current; motor constant.
_OPEN, _CONSTANT = 1e9, [1.0, 0.0]


def sum_falls(exponent: float) -> list[tuple[float, float]]:
    """Weights and speeds of terms exp(-(x/speed)^2) that add up to exp(-x^exponent); one if it is near 2."""
    if exponent > 1.9:
        return [(1.0, 1.0)]
    x = np.concatenate([np.linspace(0.0, 1.0, 60), np.linspace(1.0, 6.0, 60)])
    weights, _ = nnls(np.exp(-((x[:, None] / _SPEEDS) ** 2)), np.exp(-(x**exponent)))
    kept = weights > _LEAST_SHARE * weights.sum()
    shares = weights[kept] / weights[kept].sum()
    return list(zip(shares.tolist(), _SPEEDS[kept].tolist(), strict=True))


def add_passive_motors(spec: mujoco.MjSpec, name: str, held: Holdings, j: int) -> float:
    """Add the passive motors for a joint's friction and waves; return its remaining Coulomb friction.

    Parameters
    ----------
    spec : MjSpec
    name : str
        Name of the joint.
    held : Holdings
    j : int
        Index of the joint.
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


#: Name of the body and link of the declared payload.
PAYLOAD = "payload"
#: Least moment of inertia of a payload, since formats refuse that of a point mass [kg m^2].
_LEAST = 1e-9


def write_urdf(model: RobotModel, held: Holdings) -> str:
    """URDF with friction and damping under ``dynamics`` and the payload as a link of its own."""
    dynamics = zip(held.damping, held.friction, strict=True)
    return urdf.write_urdf(_mount_payload(held), dict(zip(model.joints, dynamics, strict=True)))


def _mount_payload(held: Holdings) -> Tree:
    """The robot's tree with the payload as a link of its own, fixed to the last link."""
    tree, payload = parse_urdf(held.body.urdf_text()), held.body.payload
    if payload is None or not payload.mass > 0.0:
        return tree
    body = Inertia.from_parameters(payload.parameters)
    body.tensor[np.diag_indices(3)] = np.maximum(np.diag(body.tensor), _LEAST)
    last = next(joint.child for joint in tree.joints if joint.name == held.body.names[-1])
    mount = Joint(f"{PAYLOAD}_mount", "fixed", last, PAYLOAD, Pose(), (1.0, 0.0, 0.0))
    links = {**tree.links, PAYLOAD: make_link(PAYLOAD, body)}
    return Tree(tree.name, tree.root, links, [*tree.joints, mount])


def write_mjcf(model: RobotModel, held: Holdings) -> str:
    """MJCF with armature, friction loss, damping, springs, payload and one torque motor per joint."""
    return make_spec(model, held).to_xml()


def write_isaac_lab(model: RobotModel, held: Holdings) -> str:
    """Settings of Isaac Lab's actuators by joint, named as in its ``ImplicitActuatorCfg``.

    It has static friction at rest and dynamic friction in motion [N m or N]. Where friction falls with the
    speed, its value at rest is the static friction.
    """
    settings, tree = {}, parse_urdf(model.urdf_text)
    for j, name in enumerate(model.joints):
        static = float(held.friction[j]) + sum(level for level, _, _ in held.falling.get(j, []))
        one = {
            "armature": float(held.armature[j]),
            "friction": static,
            "dynamic_friction": float(held.friction[j]),
            "viscous_friction": float(held.damping[j]),
        }
        limits = zip(("effort_limit_sim", "velocity_limit_sim"), own_limits(model, tree, name), strict=True)
        settings[name] = one | {key: limit for key, limit in limits if np.isfinite(limit)}
    return json.dumps(settings, indent=2) + "\n"


def own_limits(model: RobotModel, tree: Tree, name: str) -> tuple[float, float]:
    """Torque and speed limit of a joint by the URDF, since a corrected model's limits are the recordings'.

    Where the URDF states none, it is the model's limit; where that states none either, it is infinite.
    """
    stated, j = next(joint for joint in tree.joints if joint.name == name), model.joints.index(name)
    speed = np.inf if model.drive.speed_limit is None else float(model.drive.speed_limit[j])
    torque = stated.effort if stated.effort < OPEN_LIMIT else float(model.torque_limit[j])
    return float(torque), float(stated.velocity if stated.velocity < OPEN_LIMIT else speed)


def make_spec(model: RobotModel, held: Holdings) -> mujoco.MjSpec:
    """MuJoCo's specification of the robot, from which it is compiled or written as MJCF."""
    tree = _mount_payload(held)
    spec = mujoco.MjSpec()
    spec.modelname = model.name
    spec.compiler.degree = False
    spec.option.gravity = list(model.gravity)
    spec.option.timestep = 1e-3
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    bodies = {tree.root: spec.worldbody}
    for joint in tree.joints:
        body = bodies[joint.parent].add_body(name=joint.child, pos=list(joint.pose.xyz))
        body.quat = _quaternion(joint.pose.rpy)
        _give_inertia(body, tree.links[joint.child])
        bodies[joint.child] = body
        if joint.name in model.joints:
            _add_joint(spec, body, model, held, tree, joint.name)
    return spec


def _add_joint(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, model: RobotModel, held: Holdings, tree: Tree, name: str
) -> None:
    stated = next(joint for joint in tree.joints if joint.name == name)
    j = model.joints.index(name)
    kind = mujoco.mjtJoint
    joint = body.add_joint(name=name, axis=list(stated.axis))
    joint.type = kind.mjJNT_SLIDE if stated.kind == "prismatic" else kind.mjJNT_HINGE
    joint.armature = float(held.armature[j])
    joint.frictionloss = add_passive_motors(spec, name, held, j)
    joint.damping = [float(held.damping[j]), float(held.quadratic[j]), 0.0]
    if held.stiffness[j] > 0.0:
        joint.stiffness = [float(held.stiffness[j]), 0.0, 0.0]
        joint.springref = float(-held.preload[j] / held.stiffness[j])
    # The URDF's limits are taken, since a corrected model's limits are the recordings'.
    if max(abs(stated.lower), abs(stated.upper)) < OPEN_LIMIT:
        joint.limited, joint.range = True, [float(stated.lower), float(stated.upper)]
    add_gear(spec, body, joint, held, j)
    motor = spec.add_actuator(name=name, target=name)
    motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
    limit, _ = own_limits(model, tree, name)
    if np.isfinite(limit):
        motor.ctrllimited, motor.ctrlrange = True, [-limit, limit]


def _give_inertia(body: mujoco.MjsBody, link: Link) -> None:
    inertia = link.inertia()
    about = inertia.tensor
    body.mass, body.ipos, body.explicitinertial = float(inertia.mass), inertia.com.tolist(), True
    body.fullinertia = [about[0, 0], about[1, 1], about[2, 2], about[0, 1], about[0, 2], about[1, 2]]


def _quaternion(rpy: tuple[float, ...]) -> list[float]:
    quat = np.zeros(4)
    mujoco.mju_euler2Quat(quat, np.array(rpy, dtype=float), "XYZ")
    return quat.tolist()
