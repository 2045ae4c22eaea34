"""What effects change in a simulated robot."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Term:
    """A torque term installed in a plant: an effect's row at a joint with its numbers."""

    row: Callable
    joint: int
    shape: np.ndarray
    coefficients: np.ndarray
    n_states: int
    effect: str = ""


@dataclass
class Plant:
    """What effects change in a simulated robot of `n` joints.

    Attributes
    ----------
    terms : list of Term
        Joint torques, evaluated at the end-of-step speed.
    armature : ndarray (n,)
        Inertia on the motor side of the transmission, reflected to the joint.
    inertials : ndarray (n, 10)
        Additional inertial parameters of each joint's link, in its frame: mass [kg], first moments [kg m],
        inertia about the frame's origin [kg m^2] (xx, xy, yy, xz, yz, zz).
    compliance : ndarray (n,)
        Deflection of the transmission per torque; 0 is rigid.
    lost_motion : ndarray (n,)
        Total lost motion of the transmission at torque reversal.
    mesh_torque : ndarray (n,)
        Torque at which the lost motion is taken up: the deflection is
        ``lost_motion / 2 * tanh(torque / mesh_torque)``.
    torque_gain, torque_delay : ndarray (n,)
        Gain error [-] and lag [s] of the recorded torque.
    """

    n: int
    terms: list[Term] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.armature = np.zeros(self.n)
        self.inertials = np.zeros((self.n, 10))
        self.compliance = np.zeros(self.n)
        self.lost_motion = np.zeros(self.n)
        self.mesh_torque = np.ones(self.n)
        self.torque_gain = np.zeros(self.n)
        self.torque_delay = np.zeros(self.n)
