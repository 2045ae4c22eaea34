"""Robots of a few joints, as the URDF that tests write."""

from dataclasses import dataclass

JOINT = """<link name="l{k}"><inertial><origin xyz="{com}" rpy="{principal}"/><mass value="{mass}"/>
<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{name}" type="{kind}"><origin xyz="{at}" rpy="{turned}"/><axis xyz="{axis}"/>{limit}
<parent link="{carrier}"/><child link="l{k}"/></joint>"""
LIMIT = '<limit lower="{}" upper="{}" effort="{}" velocity="{}"/>'


@dataclass(frozen=True)
class Joint:
    """A joint and its link: axis, mass [kg], centre of mass, moments about it, place on the link before."""

    name: str
    axis: str = "0 0 1"
    mass: float = 1.0
    com: str = "0 0 0"
    moments: str = "1 1 1"
    at: str = "0 0 0"
    kind: str = "revolute"
    #: Lower and upper position, effort and speed; none is stated where it is empty.
    limits: str = ""
    #: Roll, pitch and yaw of the joint, and of the moments' axes.
    turned: str = "0 0 0"
    principal: str = "0 0 0"
    #: Link that carries it where that is not the one before.
    parent: str = ""


def describe_joint(k: int, joint: Joint) -> str:
    """The joint and its link ``l{k}``."""
    more = dict(zip(("xx", "yy", "zz"), joint.moments.split(), strict=True))
    more["limit"] = LIMIT.format(*joint.limits.split()) if joint.limits else ""
    more["carrier"] = joint.parent or (f"l{k - 1}" if k > 1 else "base")
    return JOINT.format(k=k, **vars(joint), **more)


def describe_robot(*joints: Joint) -> str:
    """A tree on the link ``base``; the links of the joints are ``l1`` and on."""
    parts = [describe_joint(k, joint) for k, joint in enumerate(joints, 1)]
    return "\n".join(['<robot name="arm"><link name="base"/>', *parts, "</robot>"])
