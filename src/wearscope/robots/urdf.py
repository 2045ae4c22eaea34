"""Reads URDF files into a tree of links and joints, normalises them, and writes them back.

A normalised file means the same to Pinocchio, PyBullet and MuJoCo. Visuals and collisions are removed. Links
behind fixed or locked joints are merged into their parents. The inertial frame of every link lies along its
principal axes. Continuous joints become revolute joints with wide limits. The root has no mass, which fixes
it to the world in PyBullet.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wearscope import limits
from wearscope.errors import InputError
from wearscope.robots.model_file import read_text
from wearscope.robots.spatial import (
    Array,
    Inertia,
    add_inertias,
    diagonalise_tensor,
    matrix_to_rpy,
    rpy_to_matrix,
)

# Value of a limit that a URDF does not state: position of continuous joints, effort or velocity.
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
    """A joint as the URDF states it; a limit that it does not state is `OPEN_LIMIT`.

    `friction` [N m or N] and `damping` [N m s/rad or N s/m] are NaN where the URDF states no value above 0.
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
    """Links and joints of one robot; a joint comes after the joints that carry it."""

    name: str
    root: str
    links: dict[str, Link]
    joints: list[Joint]


def _numbers(element: ET.Element | None, key: str, default: str, count: int, where: str) -> tuple[float, ...]:
    """Read the numbers of an attribute; refuse another count, and values that are not finite or too large."""
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
    """Read the name of an element; refuse an empty one, and one that is too long for simulators."""
    name = element.get("name") or default
    if not name or len(name) > limits.NAME:
        told = f"has more than {limits.NAME} characters" if name else "is empty"
        raise InputError(f"{source}: {element.tag} name '{name[:30]}' {told}; give each its own.")
    return name


def _read_pose(element: ET.Element, where: str) -> Pose:
    """Read the origin of an element; zero where it states none."""
    origin = element.find("origin")
    return Pose(_numbers(origin, "xyz", "0 0 0", 3, where), _numbers(origin, "rpy", "0 0 0", 3, where))


def _read_link(element: ET.Element, source: str) -> Link:
    """Read a link's name and inertial data."""
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
    """Read a joint; refuse an unknown type, an axis of length 0 and limits in the wrong order."""
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
    """Read friction or damping of a joint; NaN where it is not a number above 0."""
    try:
        number = float(element.find("dynamics").get(key, "nan"))  # type: ignore[union-attr]
    except (AttributeError, ValueError):
        return math.nan
    return number if 0.0 < number < math.inf else math.nan


def read_urdf(text_or_path: str | Path) -> tuple[str, str]:
    """Return the text of a URDF and its name in messages; a string that starts with ``<`` is the text itself.

    Raises
    ------
    InputError
        Where there is no such file, or it is not text.
    """
    if isinstance(text_or_path, str) and text_or_path.lstrip().startswith("<"):
        return text_or_path, "URDF"
    return read_text(text_or_path, "the robot's URDF"), str(text_or_path)


def parse_urdf(text_or_path: str | Path) -> Tree:
    """Read the links and joints of a URDF; meshes are never opened.

    Raises
    ------
    InputError
        Where the XML is broken, a name is missing or used twice, a number is not finite, or the links do not
        form one tree.
    """
    text, source = read_urdf(text_or_path)
    # Only a DOCTYPE can declare entities, which may expand without bounds or include other files.
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
    # Simulators accept a joint to the frame "world" although no link of this name is declared.
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
    """Return the root link and the joints, parents first; refuse links that do not form one tree."""
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
    """Make an XML element with its children."""
    node = ET.Element(tag, attributes)
    node.extend(children)
    return node


def _write(values: Sequence[float]) -> str:
    """Write numbers with all their digits, separated by blanks."""
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
    """Return the text of a link exactly as `write_urdf` writes it."""
    node = _make_link(link)
    ET.indent(node, level=1)
    return ET.tostring(node, encoding="unicode")


def write_urdf(tree: Tree, dynamics: Mapping[str, tuple[float, float]] | None = None) -> str:
    """Return the text of a normalised tree; numbers keep all their digits.

    `dynamics` gives damping and friction by joint name; they are 0 for the other joints.
    """
    links = [Link(tree.root) if link.name == tree.root else link for link in tree.links.values()]
    joints = [_make_joint(joint, *(dynamics or {}).get(joint.name, (0.0, 0.0))) for joint in tree.joints]
    robot = _make("robot", {"name": tree.name}, *map(_make_link, links), *joints)
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


# Mass [kg] and moment [kg m^2] that a massless moving link gets where `strict` is off. They are too small to
# matter and large enough to divide by.
TINY_MASS, TINY_MOMENT = 1e-4, 1e-6
# A principal moment may exceed the sum of the other two by this share, as rounded numbers do; it is corrected
# without a note.
TRIANGLE_TOLERANCE = 1e-3
# A principal moment stays below the sum of the other two by at least this share of the trace. PyBullet would
# set a tensor to zero that breaks this triangle inequality, if only by rounding.
TRIANGLE_MARGIN = 1e-9


def movable_joints(tree: Tree) -> list[str]:
    """Return the names of the joints with a motor of their own (movable and not mimicking), parents first."""
    return [joint.name for joint in tree.joints if joint.kind in MOVABLE and joint.mimics is None]


def free_joints(tree: Tree) -> tuple[list[str], list[str]]:
    """Return the movable joints that no other joint mimics, parents first, and notes on those left out."""
    followed = {joint.mimics for joint in tree.joints}
    every = movable_joints(tree)
    notes = [
        f"{name}: left out and locked at 0, as other joints follow it." for name in every if name in followed
    ]
    return [name for name in every if name not in followed], notes


def _check_joints(tree: Tree, joints: Sequence[str], source: str) -> None:
    """Refuse joints that do not exist, cannot move, are named twice, mimic others or are mimicked."""
    by_name = {joint.name: joint for joint in tree.joints}
    if not joints:
        raise InputError(f"{source}: no movable joint; name a URDF with revolute or prismatic joints.")
    for name in joints:
        if name not in by_name:
            raise InputError(
                f"{source}: has no joint '{name}'; its movable joints are {', '.join(movable_joints(tree))}."
            )
        if not name.isprintable():
            raise InputError(f"{source}: joint '{name}' is named with a control character; rename it.")
        if by_name[name].kind not in MOVABLE:
            raise InputError(
                f"{source}: joint '{name}' is {by_name[name].kind}; only revolute, continuous and prismatic "
                "joints can be moved, so leave it out of the joints."
            )
        if by_name[name].mimics is not None:
            raise InputError(
                f"{source}: joint '{name}' mimics '{by_name[name].mimics}' and has no motor of its own; "
                "leave it out of the joints."
            )
    if len(set(joints)) != len(joints):
        raise InputError(f"{source}: a joint is named twice in {', '.join(joints)}; name each once.")
    for joint in tree.joints:
        if joint.mimics in joints:
            raise InputError(
                f"{source}: joint '{joint.name}' mimics '{joint.mimics}'; coupled joints are not simulated, "
                f"so leave '{joint.mimics}' out of the joints and record it at rest, or make '{joint.name}' "
                "fixed where its motion needs no torque."
            )


def _check_body(link: Link, parts: list[str], strict: bool, source: str) -> tuple[Link, str | None]:
    """Check a body's mass and inertia; return it, corrected where that is allowed, and a note on that."""
    where = f"{source}: link '{link.name}'"
    if len(parts) > 1:
        where += f" (with {', '.join(repr(part) for part in parts[1:])})"
    if link.mass < 0.0:
        raise InputError(f"{where} has the mass {link.mass:g} kg; give it its real mass.")
    if link.mass == 0.0:
        if strict:
            raise InputError(f"{where} moves but has no mass; add an <inertial> with its mass and inertia.")
        return (
            replace(link, mass=TINY_MASS, tensor=TINY_MOMENT * np.eye(3)),
            f"link '{link.name}' has no mass; it was given {TINY_MASS:g} kg",
        )
    # Half the trace minus a principal moment is the integral of x^2 dm along that axis, which is not
    # negative.
    second = 0.5 * np.trace(link.tensor) - np.diag(link.tensor)
    floor = TRIANGLE_MARGIN * max(abs(float(np.trace(link.tensor))), TINY_MOMENT)
    if np.all(second >= floor):
        return link, None
    excess = float(-second.min()) / max(float(np.trace(link.tensor)), 1e-300)
    broken = np.any(np.diag(link.tensor) <= 0.0) or excess > TRIANGLE_TOLERANCE
    if strict and broken:
        moments = ", ".join(f"{value:.4g}" for value in np.diag(link.tensor))
        raise InputError(
            f"{where} has the principal moments {moments} kg m^2, which no body of {link.mass:g} kg has "
            "(each positive, none above the sum of the other two); correct its <inertia>."
        )
    if np.trace(link.tensor) <= 0.0:
        corrected = link.mass * TINY_MOMENT / TINY_MASS * np.eye(3)
    else:
        second = np.maximum(second, 2.0 * floor)
        corrected = np.diag(second.sum() - second)
    note = (
        f"link '{link.name}' had an inertia that no body has; the nearest one was taken" if broken else None
    )
    return replace(link, tensor=corrected), note


def _place_bodies(
    tree: Tree, joints: Sequence[str], locked: Mapping[str, float]
) -> tuple[dict[str, list[tuple[str, Array, Array]]], list[Joint]]:
    """Group the links into bodies; return each body's links with their poses, and the joints that move.

    A body is a link behind a moving joint, with all links that are rigidly connected to it.
    """
    carrier = {tree.root: (tree.root, np.eye(3), np.zeros(3))}
    bodies: dict[str, list[tuple[str, Array, Array]]] = {tree.root: [(tree.root, np.eye(3), np.zeros(3))]}
    kept: list[Joint] = []
    for joint in tree.joints:
        body, rotation, translation = carrier[joint.parent]
        at = rotation @ np.array(joint.pose.xyz) + translation
        turned = rotation @ rpy_to_matrix(joint.pose.rpy)
        angle, axis = locked.get(joint.name, 0.0), np.array(joint.axis)
        if angle and joint.name not in joints:
            at = at + angle * turned @ axis if joint.kind == "prismatic" else at
            if joint.kind != "prismatic":
                turned = turned @ Rotation.from_rotvec(angle * axis).as_matrix()
        if joint.name in joints:
            carrier[joint.child] = (joint.child, np.eye(3), np.zeros(3))
            bodies[joint.child] = [(joint.child, np.eye(3), np.zeros(3))]
            # An unchanged origin is kept to the last digit, so that normalising twice changes nothing.
            pose = joint.pose if body == joint.parent else Pose(tuple(at), tuple(matrix_to_rpy(turned)))
            kept.append(replace(joint, parent=body, pose=pose))
        else:
            carrier[joint.child] = (body, turned, at)
            bodies[body].append((joint.child, turned, at))
    return bodies, kept


def _lump(tree: Tree, name: str, parts: list[tuple[str, Array, Array]]) -> Link:
    """Merge the links of a body into one; a link that is alone and has principal axes is kept unchanged."""
    own = tree.links[name]
    heavy = [part for part in parts if tree.links[part[0]].mass or np.any(tree.links[part[0]].tensor)]
    if [part[0] for part in heavy] == [name] and not np.any(own.tensor[np.triu_indices(3, 1)]):
        return own
    whole = add_inertias([tree.links[part].inertia().moved(turn, at) for part, turn, at in heavy])
    return make_link(name, whole)


def normalise_tree(
    text_or_path: str | Path,
    joints: Sequence[str] | None = None,
    strict: bool = True,
    locked: Mapping[str, float] | None = None,
) -> tuple[Tree, list[str]]:
    """Normalise as `normalise_urdf`, with joints `locked` at given positions; return the tree and notes."""
    tree = parse_urdf(text_or_path)
    source = read_urdf(text_or_path)[1]
    wanted = movable_joints(tree) if joints is None else list(joints)
    if joints is None:
        for joint in tree.joints:
            if joint.kind in ("floating", "planar"):
                raise InputError(
                    f"{source}: joint '{joint.name}' is {joint.kind}; name the joints that move."
                )
    _check_joints(tree, wanted, source)
    if len(wanted) > limits.JOINTS:
        raise InputError(
            f"{source}: {len(wanted)} joints move, more than {limits.JOINTS}; name those that are wanted."
        )
    for link in tree.links.values():
        if not 0.0 <= link.mass <= limits.MASS:
            raise InputError(f"{source}: link '{link.name}' has the mass {link.mass:g} kg; correct it.")
    locked = locked or {}
    for name in locked:
        if name not in movable_joints(tree):
            raise InputError(
                f"{source}: has no joint '{name}' to be locked; its movable joints are "
                f"{', '.join(movable_joints(tree))}."
            )
    bodies, kept = _place_bodies(tree, wanted, locked)
    links, notes = {tree.root: Link(tree.root)}, []
    kept.sort(key=lambda joint: wanted.index(joint.name))
    for joint in kept:
        parts = bodies[joint.child]
        link, note = _check_body(_lump(tree, joint.child, parts), [part[0] for part in parts], strict, source)
        links[joint.child] = link
        notes += [note] if note else []
    return Tree(tree.name, tree.root, links, kept), notes


def normalise_urdf(text_or_path: str | Path, joints: Sequence[str] | None = None, strict: bool = True) -> str:
    """Normalise a URDF, so that it means the same to every simulator; see the module's description.

    Parameters
    ----------
    text_or_path : str or Path
        The XML, or the path of the file.
    joints : sequence of str, optional
        Joints that move, in the wanted order; every other joint is locked at 0. By default all movable
        joints.
    strict : bool
        Whether to refuse a moving link whose mass or inertia, after merging, is missing or not physical.
        Otherwise a massless link gets a tiny mass, and an impossible tensor is replaced by the nearest
        possible one.

    Returns
    -------
    str
        URDF text: a root without mass, and one link and one joint for each of `joints`, in that order. Names,
        frames and limits are those of the original. It has no damping or friction. Normalising it again
        returns the same text.

    Raises
    ------
    InputError
        Where the file cannot be used; names the link or joint and the remedy.
    """
    return write_urdf(normalise_tree(text_or_path, joints, strict)[0])


def make_link(name: str, inertia: Inertia) -> Link:
    """Return a link with an inertia that is given in the link's frame; its inertial frame is principal."""
    moments, axes = diagonalise_tensor(inertia.tensor)
    rpy = (0.0, 0.0, 0.0) if np.array_equal(axes, np.eye(3)) else tuple(matrix_to_rpy(axes))
    return Link(name, Pose(tuple(inertia.com), rpy), inertia.mass, np.diag(moments))


def replace_inertias(urdf_text: str, inertias: Mapping[str, Inertia]) -> str:
    """Return a normalised URDF with other inertias, given by joint name in the frame of the joint's link."""
    tree = parse_urdf(urdf_text)
    changed = {
        joint.child: make_link(joint.child, inertias[joint.name])
        for joint in tree.joints
        if joint.name in inertias
    }
    return write_urdf(Tree(tree.name, tree.root, {**tree.links, **changed}, tree.joints))
