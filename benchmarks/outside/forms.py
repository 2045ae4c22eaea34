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


def _counterbalance(s, j, p):
    """A coil spring between a pivot on the base and a crank on the link; longest where the arm is upright."""
    crank, base = 0.12 + 0.05 * p[0], 0.6
    angle = s.q[:, j] - 0.3 * (p[1] - 0.5)
    length = np.sqrt(crank**2 + base**2 - 2 * crank * base * np.cos(angle))
    return -(length - (base - crank) * 0.8) * crank * base * np.sin(angle) / length


def _temperature(s, j, p):
    thin = np.exp(-(s.temperature[:, j] - 25.0) / (18.0 + 20.0 * p[0])) - 1.0
    return thin * (s.pace(j) + 0.4 * s.sign(j))


def _ripple(s, j, p):
    angle, phase = round(8 + 16 * p[0]) * s.q[:, j], 2 * np.pi * p[1]
    return np.sin(angle + phase) + 0.3 * np.sin(2 * angle + 2 * np.pi * p[2])


def _next(s, j):
    return s.q[:, (j + 1) % s.q.shape[1]]


#: Effects of the vocabulary that add a torque.
NAMED = {
    "stribeck": lambda s, j, p: np.exp(-((s.pace(j) / (0.05 + 0.06 * p[0])) ** 2)) * s.sign(j),
    "coulomb_asymmetry": lambda s, j, p: np.abs(s.sign(j)) * (1.0 if p[0] < 0.5 else -1.0),
    "viscous_asymmetry": lambda s, j, p: (np.maximum if p[0] < 0.5 else np.minimum)(s.pace(j), 0.0),
    "quadratic_viscous": lambda s, j, p: s.pace(j) * np.abs(s.pace(j)),
    # A lubricant that thins: slope falls with speed towards a second, smaller one.
    "concave_viscous": lambda s, j, p: np.arcsinh(s.pace(j) / (0.06 + 0.06 * p[0])),
    "load_dependent_friction": lambda s, j, p: np.abs(s.load[:, j]) * s.sign(j),
    "temperature_dependent_friction": _temperature,
    "warm_up_drift": lambda s, j, p: np.exp(-s.t / (6.0 + 8.0 * p[0])) * (s.pace(j) + 0.5 * s.sign(j)),
    "torque_ripple": _ripple,
    "joint_spring": lambda s, j, p: s.q[:, j] - (p[0] - 0.5),
    "gravity_counterbalance": _counterbalance,
    "cross_coupling": lambda s, j, p: s.sign(j - 1) + 0.8 * s.pace(j - 1),
    "torque_offset": lambda s, j, p: np.ones(len(s.t)),
}
#: Effects that the vocabulary has no name for; a run of one sample, inside a control loop, has no step.
OUTSIDERS = {
    "square_in_time": lambda s, j, p: np.sign(np.sin(2 * np.pi * s.t / (2.3 + 2.5 * p[0]) + 6 * p[1])),
    "step_in_time": lambda s, j, p: 1.0 * ((s.t > s.t[-1] * (0.35 + 0.3 * p[0])) & (len(s.t) > 1)),
    "product_of_positions": lambda s, j, p: (s.q[:, j] - 0.3 * p[0]) * (_next(s, j) + 0.3 * p[1]),
    "position_times_speed": lambda s, j, p: _next(s, j) * s.pace(j),
    "load_times_speed": lambda s, j, p: s.load[:, j] * s.pace(j),
}
FORMS = NAMED | OUTSIDERS
