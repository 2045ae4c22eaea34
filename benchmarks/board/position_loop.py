"""A torque disturbance inside a position loop: the motion reacts, and the recorded torque is the command.

With q_r the reference, e = q_r - q, M the mass matrix with rotors and M_r its value at the reference, the
machine obeys M q'' + h(q, q') + friction(q') = u - d, and the controller's command u makes the error obey

    e'' + kd e' + kp e = M_r^-1 d

(computed torque, its feedback weighted by the mass matrix). What is recorded is u = M q'' + h + friction +
d along the motion that happens: nothing in the data is linearised, and the command holds the disturbance
only as far as the loop passes it on.
"""

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.interpolate import interp1d
from scipy.signal import cont2discrete, lfilter

from benchmarks.board.machines import Body
from wearscope.demonstration.motions import Motion

Array = NDArray[np.float64]

DAMPING = 0.9
"""Damping ratio of the loop."""


def solve_inertia(body: Body, rotor: Array, motion: Motion, torque: Array, every: float = 0.05) -> Array:
    """Acceleration M^-1 d (N, n) of a torque d (N, n), with the mass matrix along a motion.

    The inverse mass matrix is worked out every `every` seconds and interpolated.
    """
    step = motion.t[1] - motion.t[0]
    at = np.unique(np.append(np.arange(0, len(motion.t), max(1, round(every / step))), len(motion.t) - 1))
    inverse = []
    for i in at:
        mass = pin.crba(body.model, body.data, motion.q[i])
        inverse.append(np.linalg.inv(np.triu(mass) + np.triu(mass, 1).T + np.diag(rotor)))
    along = interp1d(motion.t[at], np.array(inverse), axis=0)(motion.t)
    return np.asarray(np.einsum("tij,tj->ti", along, torque))


def react(body: Body, rotor: Array, motion: Motion, disturbance: Array, bandwidth: float) -> Motion:
    """Motion that happens where a torque disturbance acts inside the position loop.

    Parameters
    ----------
    body : Body
    rotor : array (n,)
        Rotor inertia reflected to the joint.
    motion : Motion
        The reference, on a uniform grid.
    disturbance : array (N, n)
        Torque that opposes the drive [torque unit of the joint], held over each step of the grid.
    bandwidth : float
        Natural frequency of the loop [Hz].

    Returns
    -------
    Motion
        `q`, `v`, `a` of the machine itself; the loop starts settled under the disturbance's mean.
    """
    omega = 2 * np.pi * bandwidth
    kp, kd = omega**2, 2 * DAMPING * omega
    push = solve_inertia(body, rotor, motion, disturbance)
    step = float(motion.t[1] - motion.t[0])
    system = (np.array([[0.0, 1.0], [-kp, -kd]]), np.array([[0.0], [1.0]]), np.eye(2), np.zeros((2, 1)))
    a, b, *_ = cont2discrete(system, step, method="zoh")
    # both states as one transfer function each, so that the recursion runs in compiled code
    denominator = np.array([1.0, -np.trace(a), np.linalg.det(a)])
    settled = push.mean(axis=0)
    error = np.empty((2, *push.shape))
    for state in range(2):
        other = 1 - state
        first = float(b[state, 0])
        second = float(a[state, other] * b[other, 0] - a[other, other] * b[state, 0])
        error[state] = lfilter([0.0, first, second], denominator, push - settled, axis=0)
    e, rate = error[0] + settled / kp, error[1]
    curvature = push - kd * rate - kp * e
    return Motion(motion.t, motion.q - e, motion.v - rate, motion.a - curvature)
