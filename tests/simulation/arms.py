"""A small robot and motions for it, shared by the tests of the simulation."""

import numpy as np

from wearscope.cycles.base import Reference
from wearscope.robots.model import RobotModel, make_model

# A chain with a tilted and a translating joint, and a side branch that makes it a tree.
URDF = """<robot name="arm"><link name="base"/>
<link name="l1"><inertial><origin xyz="0.02 0 0.2" rpy="0.3 0.2 0.1"/><mass value="40"/>
  <inertia ixx="1.5" iyy="1.4" izz="1.0"/></inertial></link>
<joint name="turn" type="revolute"><origin xyz="0 0 0.1" rpy="0.1 0 0"/><parent link="base"/>
  <child link="l1"/><axis xyz="0 0 1"/></joint>
<link name="l2"><inertial><origin xyz="0.35 0.02 0" rpy="0 0.4 0"/><mass value="20"/>
  <inertia ixx="0.2" iyy="1.3" izz="1.2"/></inertial></link>
<joint name="lift" type="revolute"><origin xyz="0.1 0 0.4" rpy="0 0 0.2"/><parent link="l1"/>
  <child link="l2"/><axis xyz="0 1 0.2"/></joint>
<link name="l3"><inertial><origin xyz="0 0 -0.2"/><mass value="8"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.03"/></inertial></link>
<joint name="slide" type="prismatic"><origin xyz="0.7 0 0" rpy="0 0.3 0"/><parent link="l2"/>
  <child link="l3"/><axis xyz="0 0 1"/></joint>
<link name="l4"><inertial><origin xyz="0 0.1 0"/><mass value="5"/>
  <inertia ixx="0.05" iyy="0.04" izz="0.03"/></inertial></link>
<joint name="side" type="revolute"><origin xyz="0 0.3 0.1"/><parent link="l1"/><child link="l4"/>
  <axis xyz="1 0 0"/></joint>
</robot>"""
JOINTS = ["turn", "lift", "slide", "side"]


def make_arm(effects: list[tuple[str, str, dict]] | None = None, **fields) -> RobotModel:
    """The robot with effects as (joint, effect, parameters), and further fields of the model file."""
    entries = [{"joint": j, "effect": e, "parameters": p} for j, e, p in effects or []]
    base = {
        "name": "arm",
        "urdf": "arm.urdf",
        "joints": JOINTS,
        "effects": entries,
        "drive": {"rotor_inertia": [6.0, 8.0, 5.0, 1.0]},
    }
    return make_model({**base, **fields}, URDF)


def rub(coulomb: float = 12.0, viscous: float = 9.0) -> list[tuple[str, str, dict]]:
    """Coulomb and viscous friction at every joint."""
    return [(j, "coulomb", {"level": coulomb}) for j in JOINTS] + [
        (j, "viscous", {"slope": viscous}) for j in JOINTS
    ]


def swing(duration: float = 1.5, dt: float = 1e-3) -> Reference:
    """Sines of all joints, moving at the start."""
    t = np.arange(round(duration / dt)) * dt
    omega, phase = 2.0 * np.pi * np.array([0.55, 0.8, 0.7, 1.1]), np.array([0.3, 1.0, 2.0, 0.0])
    size, angle = np.array([0.6, 0.5, 0.2, 0.4]), t[:, None] * omega + phase
    return Reference(t, size * np.sin(angle), size * omega * np.cos(angle), -size * omega**2 * np.sin(angle))


def stand(duration: float = 0.3, dt: float = 1e-3, q: tuple[float, ...] = (0.1, 0.2, 0.1, 0.3)) -> Reference:
    """No motion."""
    t = np.arange(round(duration / dt)) * dt
    held = np.tile(np.array(q), (len(t), 1))
    return Reference(t, held, np.zeros_like(held), np.zeros_like(held))
