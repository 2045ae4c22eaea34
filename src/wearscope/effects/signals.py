"""The signals along which effects are evaluated."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

#: Largest size of the slopes that are kept for one run [bytes].
_KEPT = 2**22


@dataclass
class Signals:
    """Signals along which effects are evaluated.

    Attributes
    ----------
    t : ndarray (N,)
        Time since the start of the run [s].
    q, v, a : ndarray (N, n)
        Joint position, speed and acceleration.
    sign : ndarray (N, n)
        Direction of motion, -1 to 1; 0 at rest.
    load : ndarray (N, n)
        Rigid-body torque, of corrected bodies where they are known.
    temperature : ndarray (N, n)
        Joint temperature [deg C]; NaN where unknown.
    wear : ndarray (N, n)
        Wear level f of eq. (17) [-].
    rigid_body : wearscope.robots.dynamics.RigidBody or None
        The dynamics of the stated bodies, for effects that perturb it.
    torque : ndarray (N, n) or None
        Torque predicted by the model without the effect, for errors of the measurement itself.
    bandwidth : float
        Frequency [Hz] above which the signals are not used.
    factor : int
        How many of the recording's samples one of these represents.
    transmitted : ndarray (N, n) or None
        Torque through each gear, where more is known of it than `load`.
    lag : ndarray (n,) or None
        Delay [s] of each torque channel about which one is sought; about none where None.
    reversal : ndarray (N, n, 3) or None
        What would change in `sign`: by the logarithm of the speed over which it changes, and with each of two
        other forms of that change in full.
    carries : bool
        Whether the last link carries a payload whose declared mass may be wrong.
    channels : mapping of str to ndarray (N,)
        Further measured channels by column name, in the unit that the data set gives them.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    sign: np.ndarray
    load: np.ndarray
    temperature: np.ndarray
    wear: np.ndarray
    rigid_body: Any = None
    torque: np.ndarray | None = None
    bandwidth: float = np.inf
    factor: int = 1
    transmitted: np.ndarray | None = None
    lag: np.ndarray | None = None
    reversal: np.ndarray | None = None
    carries: bool = True
    channels: Mapping[str, np.ndarray] = field(default_factory=dict)
    _slopes: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=dict)

    @classmethod
    def along(
        cls,
        t: np.ndarray,
        v: np.ndarray,
        q: ArrayLike = 0.0,
        a: ArrayLike = 0.0,
        load: ArrayLike = 0.0,
        temperature: ArrayLike = 0.0,
        wear: ArrayLike = 0.0,
    ) -> Self:
        """Signals of a motion whose speeds (N, n) have a sign; numbers, also one a joint, hold throughout."""

        def fill(x: ArrayLike) -> np.ndarray:
            return np.asarray(x) if np.shape(x) == v.shape else np.full_like(v, x)

        return cls(t, fill(q), v, fill(a), np.sign(v), fill(load), fill(temperature), fill(wear))

    def load_slopes(self, joint: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives (N, n) of the rigid-body torque by position, speed and acceleration of a joint.

        The slopes of the last joints are cached.
        """
        if joint not in self._slopes:
            most = max(1, _KEPT // max(3 * self.load.nbytes, 1))
            while len(self._slopes) >= most:
                self._slopes.pop(next(iter(self._slopes)))
            move = np.zeros(self.q.shape[1])
            move[joint] = 1e-5
            along = self.rigid_body.inverse_dynamics
            here = along(self.q, self.v, self.a)
            self._slopes[joint] = (
                (along(self.q + move, self.v, self.a) - here) / 1e-5,
                (along(self.q, self.v + move, self.a) - here) / 1e-5,
                (along(self.q, self.v, self.a + move) - here) / 1e-5,
            )
        return self._slopes[joint]

    @cached_property
    def dt(self) -> float:
        """Sampling interval [s]."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else 0.0


_CENTRAL = np.array([1.0, -9.0, 45.0, 0.0, -45.0, 9.0, -1.0]) / 60.0


def differentiate(x: np.ndarray, rate: float) -> np.ndarray:
    """Central difference of sixth order along the first axis, of second order at the ends.

    The plain central difference loses (w h)^2/6 of a signal at w; after two of them the acceleration of a
    stiff robot looks like that of one with elastic joints.
    """
    if len(x) < 3:
        return np.zeros_like(x)
    slope = np.gradient(x, 1.0 / rate, axis=0)
    if len(x) >= 7:
        inner = sum(c * x[6 - k : len(x) - k] for k, c in enumerate(_CENTRAL))
        slope[3:-3] = inner * rate
    return slope
