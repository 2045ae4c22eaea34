"""URDF intake: a maker's file becomes one that Pinocchio, PyBullet and MuJoCo read alike.

Visuals and collisions go, fixed and locked links are lumped into their parents, every link left gets its
inertial frame along the principal axes, continuous joints become revolute ones with wide limits, and the root
has no mass, which fixes it to the world in PyBullet.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wearscope import limits
from wearscope.errors import InputError
from wearscope.robots.spatial import (
    Array,
    Inertia,
    add_inertias,
    diagonalise_tensor,
    matrix_to_rpy,
    rpy_to_matrix,
)
from wearscope.robots.urdf_file import MOVABLE, Joint, Link, Pose, Tree, parse_urdf, read_urdf, write_urdf

# Mass and moment of a massless movable link where `strict` is off: too small to matter, enough to divide by.
TINY_MASS, TINY_MOMENT = 1e-4, 1e-6
# A principal moment may exceed the sum of the other two by this share (rounded figures): corrected silently.
TRIANGLE_TOLERANCE = 1e-3
# The share of the trace kept between a principal moment and the sum of the other two: PyBullet sets a tensor
# that breaks the triangle inequality by rounding to zero.
TRIANGLE_MARGIN = 1e-9


def movable_joints(tree: Tree) -> list[str]:
    """Names of the joints that move on their own, parents first."""
    return [joint.name for joint in tree.joints if joint.kind in MOVABLE and joint.mimics is None]


def free_joints(tree: Tree) -> tuple[list[str], list[str]]:
    """Joints that move on their own, parents first: those that no joint follows, and notes on the others."""
    followed = {joint.mimics for joint in tree.joints}
    every = movable_joints(tree)
    notes = [
        f"{name}: left out and locked at 0, as other joints follow it." for name in every if name in followed
    ]
    return [name for name in every if name not in followed], notes


def _check_joints(tree: Tree, joints: Sequence[str], source: str) -> None:
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
                f"so make '{joint.name}' fixed or leave '{joint.mimics}' out of the joints."
            )


def _check_body(link: Link, parts: list[str], strict: bool, source: str) -> tuple[Link, str | None]:
    """Return the body, corrected where that is allowed, and a note that says what was corrected."""
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
    # Half the trace less a principal moment is the second moment of mass along its axis: never negative.
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
    """Links, each with its pose, by the body that carries them, and the joints between bodies."""
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
    """As `normalise_urdf`, with joints locked at given angles; returns the tree and what was corrected."""
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
    """Bring a URDF into the form that every engine reads alike.

    Parameters
    ----------
    text_or_path : str or Path
        The XML, or the path of the file.
    joints : sequence of str, optional
        The joints that move, in the order wanted; every other one is locked at 0. By default all that can.
    strict : bool
        Refuse a moving link whose mass or inertia is missing or not physical (after lumping). Otherwise a
        massless link gets a tiny mass, and an impossible tensor the nearest possible one.

    Returns
    -------
    str
        URDF text: the root without mass, one link and one joint for each of `joints`, in that order, with the
        links' and joints' own names, frames and limits; principal inertias; no visuals, collisions, damping
        or friction. Normalising it again returns the same text.

    Raises
    ------
    InputError
        Where the file cannot be used; names the link or joint and the remedy.
    """
    return write_urdf(normalise_tree(text_or_path, joints, strict)[0])


def make_link(name: str, inertia: Inertia) -> Link:
    """Link whose inertial frame lies along the principal axes of an inertia given in the link's frame."""
    moments, axes = diagonalise_tensor(inertia.tensor)
    rpy = (0.0, 0.0, 0.0) if np.array_equal(axes, np.eye(3)) else tuple(matrix_to_rpy(axes))
    return Link(name, Pose(tuple(inertia.com), rpy), inertia.mass, np.diag(moments))


def replace_inertias(urdf_text: str, inertias: Mapping[str, Inertia]) -> str:
    """Text of a normalised URDF with other inertias, given by joint name in the frame of the joint's link."""
    tree = parse_urdf(urdf_text)
    changed = {
        joint.child: make_link(joint.child, inertias[joint.name])
        for joint in tree.joints
        if joint.name in inertias
    }
    return write_urdf(Tree(tree.name, tree.root, {**tree.links, **changed}, tree.joints))
