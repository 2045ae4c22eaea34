"""A small robot and motions for it, shared by the tests of the simulation."""

import numpy as np
from urdf_texts import Joint, describe_robot

from wearscope.cycles.base import Reference
from wearscope.robots.model import RobotModel, make_model

# A chain with a tilted and a translating joint, and a side branch that makes it a tree.
FRAMES = {"turned": "0.1 0 0", "principal": "0.3 0.2 0.1"}, {"turned": "0 0 0.2", "principal": "0 0.4 0"}
URDF = describe_robot(
    Joint("turn", "0 0 1", 40, "0.02 0 0.2", "1.5 1.4 1.0", "0 0 0.1", **FRAMES[0]),
    Joint("lift", "0 1 0.2", 20, "0.35 0.02 0", "0.2 1.3 1.2", "0.1 0 0.4", **FRAMES[1]),
    Joint("slide", "0 0 1", 8, "0 0 -0.2", "0.1 0.1 0.03", "0.7 0 0", "prismatic", turned="0 0.3 0"),
    Joint("side", "1 0 0", 5, "0 0.1 0", "0.05 0.04 0.03", "0 0.3 0.1", parent="l1"),
)
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
