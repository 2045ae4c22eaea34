"""Torque that an effect adds at a joint, per unit of size, in forms of this examiner's own.

Each form takes a `Scene`, the joint's number and four numbers between 0 and 1 that fix its shape.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Scene:
    """What the effects of one run may depend on.

    Attributes
    ----------
    t : ndarray (M,)
        Since the run's start [s].
    q, v, a, load, temperature : ndarray (M, n)
        `load` is the rigid-body torque; temperature [deg C].
    top : ndarray (n,)
        Largest speed.
    width : float
        Speed, over `top`, over which friction changes its sign.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    load: np.ndarray
    temperature: np.ndarray
    top: np.ndarray
    width: float

    def sign(self, j):
        """Direction of motion of a joint (M,), rounded at rest."""
        return np.tanh(self.v[:, j] / (self.width * self.top[j]))

    def pace(self, j):
        """Speed of a joint over its largest (M,)."""
        return self.v[:, j] / self.top[j]


def _stribeck(s, j, p):
    return np.exp(-((s.pace(j) / (0.05 + 0.06 * p[0])) ** 2)) * s.sign(j)


def _coulomb_asymmetry(s, j, p):
    return np.abs(s.sign(j)) * (1.0 if p[0] < 0.5 else -1.0)


def _viscous_asymmetry(s, j, p):
    return np.maximum(s.pace(j), 0.0) if p[0] < 0.5 else np.minimum(s.pace(j), 0.0)


def _quadratic_viscous(s, j, p):
    return s.pace(j) * np.abs(s.pace(j))


def _concave_viscous(s, j, p):
    # A lubricant that thins: slope falls with speed towards a second, smaller one.
    return np.arcsinh(s.pace(j) / (0.06 + 0.06 * p[0]))


def _load_dependent(s, j, p):
    return np.abs(s.load[:, j]) * s.sign(j)


def _temperature(s, j, p):
    thin = np.exp(-(s.temperature[:, j] - 25.0) / (18.0 + 20.0 * p[0])) - 1.0
    return thin * (s.pace(j) + 0.4 * s.sign(j))


def _warm_up(s, j, p):
    return np.exp(-s.t / (6.0 + 8.0 * p[0])) * (s.pace(j) + 0.5 * s.sign(j))


def _ripple(s, j, p):
    k = round(8 + 16 * p[0])
    phase = 2 * np.pi * p[1]
    return np.sin(k * s.q[:, j] + phase) + 0.3 * np.sin(2 * k * s.q[:, j] + 2 * np.pi * p[2])


def _spring(s, j, p):
    return s.q[:, j] - (p[0] - 0.5)


def _counterbalance(s, j, p):
    # A coil spring between a pivot on the base and a crank on the link; longest where the arm is upright.
    crank, base = 0.12 + 0.05 * p[0], 0.6
    angle = s.q[:, j] - 0.3 * (p[1] - 0.5)
    length = np.sqrt(crank**2 + base**2 - 2 * crank * base * np.cos(angle))
    return -(length - (base - crank) * 0.8) * crank * base * np.sin(angle) / length


def _coupling(s, j, p):
    other = j - 1
    return s.sign(other) + 0.8 * s.pace(other)


def _offset(s, j, p):
    return np.ones(len(s.t))


def _square_in_time(s, j, p):
    return np.sign(np.sin(2 * np.pi * s.t / (2.3 + 2.5 * p[0]) + 6 * p[1]))


def _step_in_time(s, j, p):
    return (s.t > s.t[-1] * (0.35 + 0.3 * p[0])).astype(float) if len(s.t) > 1 else np.zeros(1)


def _product_of_positions(s, j, p):
    i = (j + 1) % s.q.shape[1]
    return (s.q[:, j] - 0.3 * p[0]) * (s.q[:, i] + 0.3 * p[1])


def _position_times_speed(s, j, p):
    i = (j + 1) % s.q.shape[1]
    return s.q[:, i] * s.pace(j)


def _load_times_speed(s, j, p):
    return s.load[:, j] * s.pace(j)


#: Effects of the vocabulary that add a torque.
NAMED = {
    "stribeck": _stribeck,
    "coulomb_asymmetry": _coulomb_asymmetry,
    "viscous_asymmetry": _viscous_asymmetry,
    "quadratic_viscous": _quadratic_viscous,
    "concave_viscous": _concave_viscous,
    "load_dependent_friction": _load_dependent,
    "temperature_dependent_friction": _temperature,
    "warm_up_drift": _warm_up,
    "torque_ripple": _ripple,
    "joint_spring": _spring,
    "gravity_counterbalance": _counterbalance,
    "cross_coupling": _coupling,
    "torque_offset": _offset,
}
#: Effects that the vocabulary has no name for.
OUTSIDERS = {
    "square_in_time": _square_in_time,
    "step_in_time": _step_in_time,
    "product_of_positions": _product_of_positions,
    "position_times_speed": _position_times_speed,
    "load_times_speed": _load_times_speed,
}
FORMS = NAMED | OUTSIDERS
