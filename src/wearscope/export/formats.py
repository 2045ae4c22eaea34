"""A model as URDF and as MJCF text."""

import json
import xml.etree.ElementTree as ET

import mujoco
import numpy as np

from wearscope.export.holdings import Holdings
from wearscope.export.passive_motors import add_gear, add_passive_motors
from wearscope.robots.model import RobotModel
from wearscope.robots.urdf_file import OPEN_LIMIT, Link, Tree, parse_urdf

#: Name of the body and link of the declared payload.
PAYLOAD = "payload"
#: Inertia given to a point mass, as formats refuse zero [kg m^2].
_LEAST = 1e-9


def write_urdf(model: RobotModel, held: Holdings) -> str:
    """URDF with friction and damping under ``dynamics`` and the payload as a link of its own."""
    robot = ET.fromstring(held.body.urdf_text())
    for node in robot.iter("joint"):
        name = node.get("name", "")
        dynamics = node.find("dynamics")
        if name in model.joints and dynamics is not None:
            j = model.joints.index(name)
            dynamics.set("damping", repr(float(held.damping[j])))
            dynamics.set("friction", repr(float(held.friction[j])))
    payload = held.body.payload
    if payload is not None and payload.mass > 0.0:
        tree = parse_urdf(model.urdf_text)
        last = next(joint.child for joint in tree.joints if joint.name == model.joints[-1])
        link = ET.SubElement(robot, "link", name=PAYLOAD)
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=" ".join(map(repr, map(float, payload.com))), rpy="0 0 0")
        ET.SubElement(inertial, "mass", value=repr(float(payload.mass)))
        xx, xy, xz, yy, yz, zz = payload.inertia
        moments = {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz}
        ET.SubElement(inertial, "inertia", {key: repr(float(value)) for key, value in moments.items()})
        joint = ET.SubElement(robot, "joint", name=f"{PAYLOAD}_mount", type="fixed")
        ET.SubElement(joint, "parent", link=last)
        ET.SubElement(joint, "child", link=PAYLOAD)
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


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
    tree = parse_urdf(held.body.urdf_text())
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
        _add_joint(spec, body, model, held, tree, joint.name)
    payload = held.body.payload
    if payload is not None and payload.mass > 0.0:
        last = next(joint.child for joint in tree.joints if joint.name == model.joints[-1])
        xx, xy, xz, yy, yz, zz = payload.inertia
        load = bodies[last].add_body(name=PAYLOAD)
        load.mass, load.ipos, load.explicitinertial = payload.mass, list(payload.com), True
        # Inertial frames are kept as stated; a point mass gets the least moments that MuJoCo accepts.
        load.fullinertia = [max(xx, _LEAST), max(yy, _LEAST), max(zz, _LEAST), xy, xz, yz]
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
