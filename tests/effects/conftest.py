"""A smooth motion of a small arm with every signal known in closed form."""

import numpy as np
import pytest

from wearscope.effects.base import Signals
from wearscope.robots.dynamics import RigidBody
from wearscope.robots.urdf import normalise_urdf

URDF = """<robot name="trio"><link name="base"/>
<link name="l1"><inertial><origin xyz="0.2 0 0.02"/><mass value="12"/>
  <inertia ixx="0.05" iyy="0.3" izz="0.3"/></inertial></link>
<joint name="one" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 1 0"/></joint>
<link name="l2"><inertial><origin xyz="0.15 0.01 0.03"/><mass value="6"/>
  <inertia ixx="0.02" iyy="0.1" izz="0.1"/></inertial></link>
<joint name="two" type="revolute"><origin xyz="0.45 0 0"/><parent link="l1"/><child link="l2"/>
  <axis xyz="0 1 0"/></joint>
<link name="l3"><inertial><origin xyz="0.02 0 0.05"/><mass value="2"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02"/></inertial></link>
<joint name="three" type="revolute"><origin xyz="0.3 0 0"/><parent link="l2"/><child link="l3"/>
  <axis xyz="1 0 0"/></joint>
</robot>"""
JOINTS = ["one", "two", "three"]


@pytest.fixture
def body() -> RigidBody:
    """Rigid body of three joints."""
    return RigidBody(normalise_urdf(URDF, JOINTS), JOINTS)


@pytest.fixture
def signals(body) -> Signals:
    """Sines of all joints at 500 Hz, temperatures that rise, wear levels that differ."""
    t = np.arange(0.0, 4.0, 2e-3)
    size, omega = np.array([0.7, 0.5, 0.9]), 2.0 * np.pi * np.array([0.5, 0.8, 1.1])
    angle = t[:, None] * omega + np.array([0.3, 1.0, 2.0])
    q, v, a = size * np.sin(angle), size * omega * np.cos(angle), -size * omega**2 * np.sin(angle)
    load = body.inverse_dynamics(q, v, a)
    temperature = 30.0 + np.outer(t, [1.0, 2.0, 3.0])
    wear = np.tile([0.0, 15.0, 40.0], (len(t), 1))
    return Signals(t, q, v, a, np.sign(v), load, temperature, wear, body, load + 2.0 * v)
