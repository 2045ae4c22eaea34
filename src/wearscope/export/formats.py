"""A model as URDF and as MJCF text."""

import json

import mujoco
import numpy as np

from wearscope.export.holdings import Holdings
from wearscope.export.passive_motors import add_gear, add_passive_motors
from wearscope.robots import urdf_file
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Inertia
from wearscope.robots.urdf import make_link
from wearscope.robots.urdf_file import OPEN_LIMIT, Joint, Link, Pose, Tree, parse_urdf

#: Name of the body and link of the declared payload.
PAYLOAD = "payload"
#: Inertia given to a point mass, as formats refuse zero [kg m^2].
_LEAST = 1e-9


def write_urdf(model: RobotModel, held: Holdings) -> str:
    """URDF with friction and damping under ``dynamics`` and the payload as a link of its own."""
    dynamics = zip(held.damping, held.friction, strict=True)
    return urdf_file.write_urdf(_mount_payload(held), dict(zip(model.joints, dynamics, strict=True)))


def _mount_payload(held: Holdings) -> Tree:
    """The robot's tree, with the payload as a last link that is fixed to the one before."""
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
    """MJCF with armature, friction loss, damping, springs, payload and a torque motor a joint."""
    return make_spec(model, held).to_xml()


def write_isaac_lab(model: RobotModel, held: Holdings) -> str:
    """Settings of Isaac Lab's actuators by joint, named as its ``ImplicitActuatorCfg`` has them.

    Its friction is static at rest and dynamic in motion [N m or N]; where friction falls with the speed, the
    static one is that at rest.
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
    """Torque and speed limit of a joint: the URDF's, as those of a corrected model are the recordings'.

    The model's limit where the URDF states none; infinite where the model states none either.
    """
    stated, j = next(joint for joint in tree.joints if joint.name == name), model.joints.index(name)
    speed = np.inf if model.drive.speed_limit is None else float(model.drive.speed_limit[j])
    torque = stated.effort if stated.effort < OPEN_LIMIT else float(model.torque_limit[j])
    return float(torque), float(stated.velocity if stated.velocity < OPEN_LIMIT else speed)


def make_spec(model: RobotModel, held: Holdings) -> mujoco.MjSpec:
    """The robot as MuJoCo builds it."""
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
    # The robot's own limits: those of a corrected model are the recordings'.
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
