"""Rotations and rigid-body inertias as arrays, and the unwrapping of angles."""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

Array = NDArray[np.float64]

# Pinocchio's ten inertial parameters: mass, first moments (3), tensor about the frame's origin (6).
PARAMETER_NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
#: The 48 ways to permute three axes and reverse their directions: permutations (48, 3), signs (48, 1, 3), and
#: determinant of each (48,), which is -1 where it makes a right-handed frame left-handed.
_ORDERS = np.repeat(list(permutations(range(3))), 8, axis=0)
_SIGNS = np.tile(list(product((1.0, -1.0), repeat=3)), (6, 1))[:, None, :]
_HANDS = np.rint(np.linalg.det(np.eye(3)[_ORDERS] * _SIGNS))


@dataclass(frozen=True)
class Inertia:
    """Mass [kg], centre of mass (3,) [m], and tensor (3, 3) [kg m^2] about it, along the frame's axes."""

    mass: float
    com: Array
    tensor: Array

    def to_parameters(self) -> Array:
        """Return the parameters (10,) in the order of `PARAMETER_NAMES`, about the frame's origin."""
        # Pinocchio's own conversion refuses inertias that are not physical, which estimates may be.
        c = self.com
        origin = self.tensor + self.mass * (c @ c * np.eye(3) - np.outer(c, c))
        i, j = np.array([0, 0, 1, 0, 1, 2]), np.array([0, 1, 1, 2, 2, 2])
        return np.concatenate(([self.mass], self.mass * c, origin[i, j]))

    @staticmethod
    def from_parameters(parameters: ArrayLike) -> "Inertia":
        """Return the inertia of parameters (10,); with a mass of 0 the centre of mass is the origin."""
        pi = np.asarray(parameters, dtype=float)
        mass = float(pi[0])
        com = pi[1:4] / mass if mass != 0.0 else np.zeros(3)
        origin = np.array([[pi[4], pi[5], pi[7]], [pi[5], pi[6], pi[8]], [pi[7], pi[8], pi[9]]])
        return Inertia(mass, com, origin - mass * (com @ com * np.eye(3) - np.outer(com, com)))

    def moved(self, rotation: Array, translation: Array) -> "Inertia":
        """Return the inertia in another frame, where this one has the pose `rotation`, `translation`."""
        tensor = rotation @ self.tensor @ rotation.T
        return Inertia(self.mass, rotation @ self.com + translation, 0.5 * (tensor + tensor.T))


def add_inertias(inertias: list[Inertia]) -> Inertia:
    """Return the inertia of several bodies that are rigidly connected, all in the same frame."""
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
    # At pitch +-90 degrees only a combination of roll and yaw is determined; roll is computed for this yaw.
    s, c = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(s * rotation[0, 2] - c * rotation[1, 2], -s * rotation[0, 1] + c * rotation[1, 1])
    return np.array([roll, pitch, yaw])


def diagonalise_tensor(tensor: Array) -> tuple[Array, Array]:
    """Return principal moments (3,) and the rotation (3, 3) of the principal frame nearest to the identity.

    A diagonal tensor is returned with the identity. The nearest frame keeps the pitch away from +-90 degrees,
    where roll and yaw are not determined.
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


#: Shares of a turn. A step of the position is a jump where it equals a full turn within `_NEAR`. Where the
#: whole recording stays within one turn, every step above `_HALF` is a jump.
_NEAR, _HALF = 0.05, 0.5


def unwrap_turns(x: Array, turn: float = 2.0 * np.pi) -> tuple[Array, int]:
    """Remove the jumps of a full turn from a position (N,); return it and the number of jumps.

    The usual motion around a step is subtracted before the step is compared with a turn. Where the recording
    contains such a jump and stays within one turn, every step above half a turn is a jump too: samples may
    lie so far apart that the joint moves on during the jump.
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
