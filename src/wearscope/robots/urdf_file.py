"""URDF files read into a tree of links and joints, and written back."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from wearscope import limits
from wearscope.errors import InputError
from wearscope.robots.model_file import read_text
from wearscope.robots.spatial import Array, Inertia, rpy_to_matrix

# A limit that a URDF leaves open (continuous joints, no effort or velocity given).
OPEN_LIMIT = 1e9
MOVABLE = ("revolute", "continuous", "prismatic")
#: Elements that a joint has at most once.
_ONCE = ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic")


@dataclass(frozen=True)
class Pose:
    """Origin of a URDF element: `xyz` (3,) [m] and `rpy` (3,) [rad]."""

    xyz: tuple[float, ...] = (0.0, 0.0, 0.0)
    rpy: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Link:
    """A link: its inertial frame, mass [kg], and tensor (3, 3) [kg m^2] along that frame's axes."""

    name: str
    pose: Pose = field(default_factory=Pose)
    mass: float = 0.0
    tensor: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def inertia(self) -> Inertia:
        """Inertia in the link's own frame."""
        return Inertia(self.mass, np.zeros(3), self.tensor).moved(
            rpy_to_matrix(self.pose.rpy), np.array(self.pose.xyz)
        )


@dataclass(frozen=True)
class Joint:
    """A joint as the URDF states it; limits are open where it states none.

    `friction` [N m or N] and `damping` [N m s/rad or N s/m] are NaN where it states none, or none above 0.
    """

    name: str
    kind: str
    parent: str
    child: str
    pose: Pose
    axis: tuple[float, ...]
    lower: float = -OPEN_LIMIT
    upper: float = OPEN_LIMIT
    effort: float = OPEN_LIMIT
    velocity: float = OPEN_LIMIT
    mimics: str | None = None
    friction: float = math.nan
    damping: float = math.nan


@dataclass(frozen=True)
class Tree:
    """Links and joints of one robot; the joints stand parents first."""

    name: str
    root: str
    links: dict[str, Link]
    joints: list[Joint]


def _numbers(element: ET.Element | None, key: str, default: str, count: int, where: str) -> tuple[float, ...]:
    text = default if element is None else element.get(key, default)
    try:
        values = tuple(float(word) for word in text.split())
    except ValueError:
        values = ()
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise InputError(f'{where}: {key}="{text[:80]}" is not {count} finite number(s); correct the URDF.')
    if any(abs(value) > limits.NUMBER for value in values):
        raise InputError(f'{where}: {key}="{text}" is above {limits.NUMBER:g}; correct the URDF.')
    return values


def _read_name(element: ET.Element, source: str, default: str = "") -> str:
    """Name of an element, which simulators cannot hold where it is long."""
    name = element.get("name") or default
    if not name or len(name) > limits.NAME:
        told = f"has more than {limits.NAME} characters" if name else "is empty"
        raise InputError(f"{source}: {element.tag} name '{name[:30]}' {told}; give each its own.")
    return name


def _read_pose(element: ET.Element, where: str) -> Pose:
    origin = element.find("origin")
    return Pose(_numbers(origin, "xyz", "0 0 0", 3, where), _numbers(origin, "rpy", "0 0 0", 3, where))


def _read_link(element: ET.Element, source: str) -> Link:
    name = _read_name(element, source)
    where = f"{source}: link '{name}'"
    inertial = element.find("inertial")
    if inertial is None:
        return Link(name)
    mass = _numbers(inertial.find("mass"), "value", "0", 1, where)[0]
    entries = inertial.find("inertia")
    xx, xy, xz, yy, yz, zz = (
        _numbers(entries, key, "0", 1, where)[0] for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    return Link(name, _read_pose(inertial, where), mass, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def _read_joint(element: ET.Element, source: str) -> Joint:
    name, kind = _read_name(element, source), element.get("type") or ""
    where = f"{source}: joint '{name}'"
    parent, child = element.find("parent"), element.find("child")
    if parent is None or child is None:
        raise InputError(f"{where} lacks <parent> or <child>; correct the URDF.")
    if kind not in (*MOVABLE, "fixed", "floating", "planar"):
        raise InputError(f"{where} has the type '{kind}', which URDF does not know; correct the URDF.")
    axis = _numbers(element.find("axis"), "xyz", "1 0 0", 3, where)
    norm = math.sqrt(sum(value * value for value in axis))
    if kind in MOVABLE:
        if norm == 0.0:
            raise InputError(f"{where} has the axis 0 0 0; give it a direction.")
        if abs(norm - 1.0) > 1e-12:
            axis = tuple(value / norm for value in axis)
    limits = element.find("limit")
    lower, upper = (_numbers(limits, key, "0", 1, where)[0] for key in ("lower", "upper"))
    effort, velocity = (_numbers(limits, key, "0", 1, where)[0] for key in ("effort", "velocity"))
    if lower > upper:
        raise InputError(f"{where} has its lower limit {lower:g} above its upper limit {upper:g}; swap them.")
    if kind == "continuous" or lower == upper:
        lower, upper = -OPEN_LIMIT, OPEN_LIMIT
    mimic = element.find("mimic")
    return Joint(
        name=name,
        kind=kind,
        parent=parent.get("link") or "",
        child=child.get("link") or "",
        pose=_read_pose(element, where),
        axis=axis,
        lower=lower,
        upper=upper,
        effort=effort if effort > 0.0 else OPEN_LIMIT,
        velocity=velocity if velocity > 0.0 else OPEN_LIMIT,
        mimics=None if mimic is None else mimic.get("joint") or "",
        friction=_read_dynamics(element, "friction"),
        damping=_read_dynamics(element, "damping"),
    )


def _read_dynamics(element: ET.Element, key: str) -> float:
    """Number of a joint's ``dynamics``; NaN where it is no number above 0."""
    try:
        number = float(element.find("dynamics").get(key, "nan"))  # type: ignore[union-attr]
    except (AttributeError, ValueError):
        return math.nan
    return number if 0.0 < number < math.inf else math.nan


def read_urdf(text_or_path: str | Path) -> tuple[str, str]:
    """Text of a URDF and the name to call it by in messages; a string that starts with ``<`` is the text.

    Raises
    ------
    InputError
        Where there is no such file, or it is not text.
    """
    if isinstance(text_or_path, str) and text_or_path.lstrip().startswith("<"):
        return text_or_path, "URDF"
    return read_text(text_or_path, "the robot's URDF"), str(text_or_path)


def parse_urdf(text_or_path: str | Path) -> Tree:
    """Read links and joints; meshes are never opened.

    Raises
    ------
    InputError
        Where the XML is broken, a name is missing or used twice, a number is not finite, or the links do not
        form one tree.
    """
    text, source = read_urdf(text_or_path)
    # Entities, which may grow without bounds or name other files, can be declared nowhere else.
    if "<!DOCTYPE" in text:
        raise InputError(f"{source}: holds a DOCTYPE, which no URDF needs; remove it.")
    try:
        robot = ET.fromstring(text)
    except (ET.ParseError, ValueError, RecursionError) as error:
        raise InputError(f"{source}: is not well-formed XML ({error}); correct the URDF.") from error
    if robot.tag != "robot":
        raise InputError(f"{source}: starts with <{robot.tag}>, not <robot>; name the robot's URDF.")
    if any("xacro" in element.tag for element in robot.iter() if isinstance(element.tag, str)):
        raise InputError(f"{source}: holds xacro macros; expand it to plain URDF first (xacro FILE).")
    links: dict[str, Link] = {}
    if robot.find("link") is None:
        raise InputError(f"{source}: has no links; name the robot's URDF.")
    if len(robot.findall("link")) > limits.LINKS:
        raise InputError(f"{source}: has more than {limits.LINKS} links; name the robot's URDF.")
    for element in robot.findall("link"):
        link = _read_link(element, source)
        if link.name in links:
            raise InputError(f"{source}: link name '{link.name}' is used twice; give each link its own.")
        links[link.name] = link
    joints: dict[str, Joint] = {}
    # Simulators weld a base to a frame of this name that nobody declares.
    if "world" not in links and any(one.get("link") == "world" for one in robot.findall("joint/parent")):
        links["world"] = Link("world")
    for element in robot.findall("joint"):
        parts = [one.tag for one in element if isinstance(one.tag, str)]
        twice = next((one for one in parts if one in _ONCE and parts.count(one) > 1), "")
        joint = _read_joint(element, source)
        if twice:
            raise InputError(f"{source}: joint '{joint.name}' has {parts.count(twice)} <{twice}>s; keep one.")
        if joint.name in joints:
            raise InputError(f"{source}: joint name '{joint.name}' is used twice; give each joint its own.")
        for end in (joint.parent, joint.child):
            if end not in links:
                raise InputError(
                    f"{source}: joint '{joint.name}' names link '{end}', which is not in the file."
                )
        joints[joint.name] = joint
    root, ordered = _order_tree(links, list(joints.values()), source)
    return Tree(_read_name(robot, source, "robot"), root, links, ordered)


def _order_tree(links: Mapping[str, Link], joints: list[Joint], source: str) -> tuple[str, list[Joint]]:
    children = [joint.child for joint in joints]
    for child in children:
        if children.count(child) > 1:
            raise InputError(
                f"{source}: link '{child}' is the child of two joints; closed chains are not read."
            )
    roots = [name for name in links if name not in set(children)]
    if len(roots) != 1:
        raise InputError(
            f"{source}: {len(roots)} links have no parent ({', '.join(roots) or 'a loop'}); "
            "join the links to one tree with one root."
        )
    ordered: list[Joint] = []
    reached, left = {roots[0]}, list(joints)
    while left:
        ready = [joint for joint in left if joint.parent in reached]
        if not ready:
            raise InputError(
                f"{source}: joint '{left[0].name}' is part of a loop; closed chains are not read."
            )
        # Depth first in the order of the file, so that a chain reads from its base to its tip.
        joint = next((j for j in ready if ordered and j.parent == ordered[-1].child), ready[0])
        ordered.append(joint)
        reached.add(joint.child)
        left.remove(joint)
    return roots[0], ordered


def _make(tag: str, attributes: dict[str, str], *children: ET.Element) -> ET.Element:
    node = ET.Element(tag, attributes)
    node.extend(children)
    return node


def _write(values: Sequence[float]) -> str:
    # Adding zero turns -0.0 into 0.0.
    return " ".join(repr(float(value) + 0.0) for value in values)


def _make_pose(pose: Pose) -> ET.Element:
    return _make("origin", {"xyz": _write(pose.xyz), "rpy": _write(pose.rpy)})


def _make_link(link: Link) -> ET.Element:
    moments = {f"i{a}{a}": _write([link.tensor[k, k]]) for k, a in enumerate("xyz")}
    mass = _make("mass", {"value": _write([link.mass])})
    inertia = _make("inertia", {**moments, "ixy": "0.0", "ixz": "0.0", "iyz": "0.0"})
    return _make("link", {"name": link.name}, _make("inertial", {}, _make_pose(link.pose), mass, inertia))


def _make_joint(joint: Joint, damping: float, friction: float) -> ET.Element:
    limits = {key: _write([getattr(joint, key)]) for key in ("lower", "upper", "effort", "velocity")}
    kind = "revolute" if joint.kind == "continuous" else joint.kind
    return _make(
        "joint",
        {"name": joint.name, "type": kind},
        _make_pose(joint.pose),
        _make("parent", {"link": joint.parent}),
        _make("child", {"link": joint.child}),
        _make("axis", {"xyz": _write(joint.axis)}),
        _make("limit", limits),
        _make("dynamics", {"damping": _write([damping]), "friction": _write([friction])}),
    )


def write_link(link: Link) -> str:
    """Text of a link as `write_urdf` has it."""
    node = _make_link(link)
    ET.indent(node, level=1)
    return ET.tostring(node, encoding="unicode")


def write_urdf(tree: Tree, dynamics: Mapping[str, tuple[float, float]] | None = None) -> str:
    """Text of a normalised tree; numbers with as many digits as they have.

    `dynamics` has the damping and friction of joints by name; those of the others are zero.
    """
    links = [Link(tree.root) if link.name == tree.root else link for link in tree.links.values()]
    joints = [_make_joint(joint, *(dynamics or {}).get(joint.name, (0.0, 0.0))) for joint in tree.joints]
    robot = _make("robot", {"name": tree.name}, *map(_make_link, links), *joints)
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"
