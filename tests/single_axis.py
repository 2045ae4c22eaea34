"""A single joint that carries a link, with given effects."""

from wearscope.robots.model import make_model

URDF_TEXT = """<robot name="axis"><link name="base"/><link name="link"><inertial><origin xyz="0.1 0 0"/>
<mass value="3"/><inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axis" type="revolute"><parent link="base"/><child link="link"/><axis xyz="0 1 0"/>
<limit lower="-2.5" upper="2.2" effort="90" velocity="2"/></joint></robot>"""
COULOMB = {"level": 3.0}
DRIVE = {
    "rotor_inertia": [0.5], "speed_limit": [1.5], "acceleration_limit": [6.0], "jerk_limit": [60.0],
}  # fmt: skip


def make_axis(*effects, **fields):
    entries = [{"joint": "axis", "effect": e, "parameters": p} for e, p in effects]
    base = {"name": "axis", "urdf": "axis.urdf", "joints": ["axis"], "drive": DRIVE, "effects": entries}
    return make_model({**base, **fields}, URDF_TEXT)
