"""The class `Signals`: motion, load and other signals along which effects are evaluated."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

#: Largest memory for the derivatives of the rigid-body torque that are kept for one run [bytes].
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
        Rigid-body torque [N m or N]; that of corrected bodies where these are known.
    temperature : ndarray (N, n)
        Joint temperature [deg C]; NaN where unknown.
    wear : ndarray (N, n)
        Wear level f of eq. (17) [-].
    rigid_body : wearscope.robots.dynamics.RigidBody or None
        Dynamics of the stated bodies, for effects that perturb them.
    torque : ndarray (N, n) or None
        Torque predicted by the model without the effect, for effects that are errors of the torque's
        measurement.
    bandwidth : float
        Frequency [Hz] above which the signals are filtered out.
    factor : int
        Number of samples of the recording that one sample of these signals represents.
    transmitted : ndarray (N, n) or None
        Torque through each gear, where it is known better than by `load`.
    lag : ndarray (n,) or None
        Delay [s] of each torque channel about which the search for a delay is linearised; None for 0.
    reversal : ndarray (N, n, 3) or None
        Derivative of `sign` with respect to the logarithm of the speed over which it changes at a reversal,
        and its differences to two other forms of that change.
    carries : bool
        Whether the last link carries a payload whose declared mass may be wrong.
    channels : mapping of str to ndarray (N,)
        Further measured channels by column name, in the data set's units.
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
        """Return the signals of a motion; the direction `sign` (N, n) is the sign of the speeds.

        A signal may be an array (N, n); a number, or an array (n,), is constant in time.
        """

        def fill(x: ArrayLike) -> np.ndarray:
            return np.asarray(x) if np.shape(x) == v.shape else np.full_like(v, x)

        return cls(t, fill(q), v, fill(a), np.sign(v), fill(load), fill(temperature), fill(wear))

    def load_slopes(self, joint: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the derivatives (N, n) of rigid-body torque by position, speed, acceleration of a joint.

        The derivatives for the last few joints are cached.
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
    """Differentiate along the first axis by central differences of sixth order, of second order at the ends.

    The central difference of second order reduces a signal of angular frequency w by the share (w h)^2/6. Two
    of them would make the acceleration of a stiff robot look like that of one with elastic joints.
    """
    if len(x) < 3:
        return np.zeros_like(x)
    slope = np.gradient(x, 1.0 / rate, axis=0)
    if len(x) >= 7:
        inner = sum(c * x[6 - k : len(x) - k] for k, c in enumerate(_CENTRAL))
        slope[3:-3] = inner * rate
    return slope
