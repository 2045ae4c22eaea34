"""A single joint that carries a link, with given effects."""

from urdf_texts import Joint, describe_robot

from wearscope.robots.model import make_model

URDF_TEXT = describe_robot(Joint("axis", "0 1 0", 3, "0.1 0 0", "0.02 0.02 0.02", limits="-2.5 2.2 90 2"))
COULOMB = {"level": 3.0}
DRIVE = {
    "rotor_inertia": [0.5], "speed_limit": [1.5], "acceleration_limit": [6.0], "jerk_limit": [60.0],
}  # fmt: skip


def make_axis(*effects, **fields):
    entries = [{"joint": "axis", "effect": e, "parameters": p} for e, p in effects]
    base = {"name": "axis", "urdf": "axis.urdf", "joints": ["axis"], "drive": DRIVE, "effects": entries}
    return make_model({**base, **fields}, URDF_TEXT)
