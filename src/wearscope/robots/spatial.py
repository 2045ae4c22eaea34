"""Rotations and rigid-body inertias as arrays: what URDF intake and dynamics share; full turns."""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

Array = NDArray[np.float64]

# Order of Pinocchio's ten inertial parameters: m, m c (3), then the tensor about the frame's origin.
PARAMETER_NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
#: The ways to order three axes and to turn them about, (48, 3) and (48, 1, 3), and their handedness (48,).
_ORDERS = np.repeat(list(permutations(range(3))), 8, axis=0)
_SIGNS = np.tile(list(product((1.0, -1.0), repeat=3)), (6, 1))[:, None, :]
_HANDS = np.rint(np.linalg.det(np.eye(3)[_ORDERS] * _SIGNS))


@dataclass(frozen=True)
class Inertia:
    """Mass [kg], centre of mass (3,) [m] in a frame, tensor (3, 3) [kg m^2] about it, along its axes."""

    mass: float
    com: Array
    tensor: Array

    def to_parameters(self) -> Array:
        """Ten parameters (10,) in the order of `PARAMETER_NAMES`, the tensor about the frame's origin."""
        # Pinocchio's own conversion refuses inertias that no body has, which estimates may hold.
        c = self.com
        origin = self.tensor + self.mass * (c @ c * np.eye(3) - np.outer(c, c))
        i, j = np.array([0, 0, 1, 0, 1, 2]), np.array([0, 1, 1, 2, 2, 2])
        return np.concatenate(([self.mass], self.mass * c, origin[i, j]))

    @staticmethod
    def from_parameters(parameters: ArrayLike) -> "Inertia":
        """Inverse of `to_parameters`; a mass of zero keeps a centre of mass at the origin."""
        pi = np.asarray(parameters, dtype=float)
        mass = float(pi[0])
        com = pi[1:4] / mass if mass != 0.0 else np.zeros(3)
        origin = np.array([[pi[4], pi[5], pi[7]], [pi[5], pi[6], pi[8]], [pi[7], pi[8], pi[9]]])
        return Inertia(mass, com, origin - mass * (com @ com * np.eye(3) - np.outer(com, com)))

    def moved(self, rotation: Array, translation: Array) -> "Inertia":
        """Express the inertia in a frame in which this one sits at `rotation` (3, 3), `translation` (3,)."""
        tensor = rotation @ self.tensor @ rotation.T
        return Inertia(self.mass, rotation @ self.com + translation, 0.5 * (tensor + tensor.T))


def add_inertias(inertias: list[Inertia]) -> Inertia:
    """One rigid body made of several that are expressed in the same frame."""
    mass = sum(i.mass for i in inertias)
    com = sum((i.mass * i.com for i in inertias), np.zeros(3)) / mass if mass > 0.0 else np.zeros(3)
    tensor = np.zeros((3, 3))
    for inertia in inertias:
        d = inertia.com - com
        tensor = tensor + inertia.tensor + inertia.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return Inertia(mass, com, 0.5 * (tensor + tensor.T))


def rpy_to_matrix(rpy: ArrayLike) -> Array:
    """Rotation matrix (3, 3) of URDF's fixed-axis roll, pitch, yaw [rad]: Rz(yaw) Ry(pitch) Rx(roll)."""
    return np.asarray(pin.rpy.rpyToMatrix(np.asarray(rpy, dtype=float)))


def matrix_to_rpy(rotation: Array) -> Array:
    """Roll, pitch, yaw (3,) [rad] of a rotation matrix, accurate at pitch +-90 degrees as well."""
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    # The roll that belongs to this very yaw: at pitch +-90 degrees only their combination is determined.
    s, c = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(s * rotation[0, 2] - c * rotation[1, 2], -s * rotation[0, 1] + c * rotation[1, 1])
    return np.array([roll, pitch, yaw])


def diagonalise_tensor(tensor: Array) -> tuple[Array, Array]:
    """Principal moments (3,) and the rotation (3, 3) of the principal frame, the one nearest to the identity.

    A tensor that is diagonal already comes back as it is. The nearest frame keeps roll, pitch and yaw away
    from the pole.
    """
    if not np.any(tensor[np.triu_indices(3, 1)]):
        return np.diag(tensor).copy(), np.eye(3)
    moments, axes = np.linalg.eigh(0.5 * (tensor + tensor.T))
    frames = axes[:, _ORDERS].transpose(1, 0, 2) * _SIGNS
    right = np.linalg.det(axes) * _HANDS > 0.0
    likeness = np.where(right, np.trace(frames, axis1=1, axis2=2), -np.inf)
    nearest = int(np.argmax(likeness))
    return moments[_ORDERS[nearest]], frames[nearest]


def pseudo_inertia(parameters: ArrayLike) -> Array:
    """Pseudo-inertia matrix (4, 4) of ten inertial parameters; physical if and only if positive definite.

    Wensing, Kim, Slotine, "Linear matrix inequalities for physically consistent inertial parameter
    identification", IEEE Robotics and Automation Letters 3(1), 2018, eq. (15).
    """
    pi = np.asarray(parameters, dtype=float)
    return np.asarray(pin.PseudoInertia.FromDynamicParameters(pi).toMatrix())


#: A jump is a step that differs from a full turn by less than the first share of a turn. Where the position
#: stays within a turn, it is any step larger than the second share.
_NEAR, _HALF = 0.05, 0.5


def unwrap_turns(x: Array, turn: float = 2.0 * np.pi) -> tuple[Array, int]:
    """Position (N,) without its jumps of a full turn, and how many there were.

    Where the position stays within a turn, every step of more than half a turn is a jump too, as between
    samples that lie far apart.
    """
    step = np.diff(x)
    if not (np.abs(step) > _HALF * turn).any():
        return x, 0
    odd = step - ndimage.median_filter(step, 11, mode="nearest")
    jumps = np.abs(np.abs(odd) - turn) < _NEAR * turn
    if jumps.any() and np.ptp(x) <= (1.0 + _NEAR) * turn:
        jumps = np.abs(step) > _HALF * turn
    turns = np.concatenate([[0.0], np.cumsum(np.sign(step) * jumps)])
    return x - turn * turns, int(jumps.sum())
