"""A smooth motion of a small arm with every signal known in closed form."""

import numpy as np
import pytest
from urdf_texts import Joint, describe_robot

from wearscope.effects.base import Signals
from wearscope.robots.dynamics import RigidBody
from wearscope.robots.urdf import normalise_urdf

URDF = describe_robot(
    Joint("one", "0 1 0", 12, "0.2 0 0.02", "0.05 0.3 0.3"),
    Joint("two", "0 1 0", 6, "0.15 0.01 0.03", "0.02 0.1 0.1", "0.45 0 0"),
    Joint("three", "1 0 0", 2, "0.02 0 0.05", "0.01 0.02 0.02", "0.3 0 0"),
)
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
