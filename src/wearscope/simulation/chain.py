"""Rigid bodies of a robot: as arrays for the compiled step, and as the URDF that PyBullet loads."""

from collections import namedtuple
from dataclasses import replace
from functools import lru_cache

import numpy as np

from wearscope.errors import InputError
from wearscope.robots.dynamics import RigidBody
from wearscope.robots.spatial import Array, Inertia, rpy_to_matrix
from wearscope.robots.urdf import Tree, make_link, parse_urdf, write_link, write_urdf


class Chain(namedtuple("Chain", "order parent prismatic offset turn axis mass com tensor gravity")):
    """Kinematic tree of one-degree-of-freedom joints on a fixed base, in joint order.

    Attributes
    ----------
    order : ndarray of int (n,)
        Joints, parents before children.
    parent : ndarray of int (n,)
        Joint that carries the joint, -1 for the base.
    prismatic : ndarray of bool (n,)
    offset : ndarray (n, 3)
        Origin of the joint in its parent's frame [m].
    turn : ndarray (n, 3, 3)
        Its orientation there.
    axis : ndarray (n, 3)
        Unit axis in the joint's frame.
    mass : ndarray (n,)
        Mass of the joint's link [kg], payload included.
    com : ndarray (n, 3)
        Centre of mass in the joint's frame [m].
    tensor : ndarray (n, 3, 3)
        Inertia about the centre of mass along the frame's axes [kg m^2].
    gravity : ndarray (3,)
        [m/s^2].
    """


def sum_parameters(body: RigidBody, extra: Array | None = None) -> Array:
    """Inertial parameters (n, 10) of each joint's link in its own frame, payload included.

    Parameters
    ----------
    body : RigidBody
    extra : ndarray (n, 10), optional
        Inertial parameters to add to the links, in the order of `wearscope.robots.spatial`. The sum need not
        be physically consistent; only its mass must be positive.

    Raises
    ------
    InputError
        Where a link would weigh nothing or less.
    """
    parameters = body.inertial_parameters.reshape(body.n, 10).copy()
    if body.payload is not None:
        parameters[-1] += body.payload.parameters
    if extra is not None:
        parameters += extra
    for name, row in zip(body.names, parameters, strict=True):
        if not row[0] > 0.0:
            raise InputError(
                f"joint '{name}': its link would weigh {row[0]:.4g} kg with payload and effects; "
                "correct the payload or the effects."
            )
    return parameters


#: A robot's URDF is the same from run to run; its tree is only read.
_read_tree = lru_cache(maxsize=16)(parse_urdf)


@lru_cache(maxsize=16)
def _find_frames(urdf_text: str, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Fields of `Chain` that follow from the kinematics alone."""
    tree = _read_tree(urdf_text)
    joints = {joint.name: joint for joint in tree.joints}
    carried_by = {joint.child: name for name, joint in joints.items()}
    parent = np.array(
        [names.index(carried_by[joints[n].parent]) if joints[n].parent in carried_by else -1 for n in names]
    )
    order: list[int] = []
    while len(order) < len(names):
        order += [j for j in range(len(names)) if j not in order and (parent[j] < 0 or parent[j] in order)]
    return {
        "order": np.array(order),
        "parent": parent,
        "prismatic": np.array([joints[n].kind == "prismatic" for n in names]),
        "offset": np.array([joints[n].pose.xyz for n in names], dtype=float),
        "turn": np.array([rpy_to_matrix(joints[n].pose.rpy) for n in names]),
        "axis": np.array([joints[n].axis for n in names], dtype=float),
    }


def build_chain(body: RigidBody, extra: Array | None = None) -> Chain:
    """Arrays of a robot's bodies.

    Parameters
    ----------
    body : RigidBody
        With its payload.
    extra : ndarray (n, 10), optional
        As for `sum_parameters`.

    Raises
    ------
    InputError
        As `sum_parameters`.
    """
    inertias = [Inertia.from_parameters(row) for row in sum_parameters(body, extra)]
    return Chain(
        **_find_frames(body.urdf_text(), tuple(body.names)),
        mass=np.array([inertia.mass for inertia in inertias]),
        com=np.array([inertia.com for inertia in inertias]),
        tensor=np.array([inertia.tensor for inertia in inertias]),
        gravity=np.array(body.gravity, dtype=float),
    )


@lru_cache(maxsize=16)
def _write_bare_plant(urdf_text: str, last: str) -> tuple[str, str, str]:
    """Return the URDF text before and after the link of joint `last`, and that link's name.

    The two texts stay the same from run to run; only that link, which holds the payload, is written anew.
    """
    tree = _read_tree(urdf_text)
    joints = [replace(joint, lower=1.0, upper=-1.0) for joint in tree.joints]
    link = tree.links[next(joint.child for joint in joints if joint.name == last)]
    before, after = write_urdf(Tree(tree.name, tree.root, tree.links, joints)).split(write_link(link))
    return before, after, link.name


@lru_cache(maxsize=16)
def write_plant_urdf(body: RigidBody) -> str:
    """Write the URDF for PyBullet: the payload belongs to the last link, and the joints have no limits.

    PyBullet would turn limits into contacts. Instead, a run that leaves the limits is refused afterwards.
    """
    last = body.names[-1]
    before, after, name = _write_bare_plant(body.urdf_text(), last)
    inertia = Inertia.from_parameters(sum_parameters(body)[-1])
    return before + write_link(make_link(name, inertia)) + after
