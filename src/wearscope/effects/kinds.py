"""Kinds of effects with rules of their own: bodies, gears, measurement errors, waves, eq. (17)."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from wearscope.effects.effect import PAYLOAD, Effect
from wearscope.effects.parameter import Parameter
from wearscope.effects.rows import Plant
from wearscope.effects.signals import Signals, differentiate

#: Number of values that describe a body's weight: its mass and three first moments.
_BODY = 4
#: Smallest believable delay, in samples of the recording; the clocks of two channels may differ by as much.
LEAST_SAMPLES = 0.1


@dataclass(frozen=True)
class RigidBodyEffect(Effect):
    """The rigid-body dynamics themselves, which every simulated plant has."""

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Return the regressors (N, 10 n) of the inertial parameters at a joint."""
        return signals.rigid_body.inertial_regressor(signals.q, signals.v, signals.a)[:, joint, :]

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Do nothing, as the plant has rigid-body dynamics anyway."""


@dataclass(frozen=True)
class InertiaEffect(Effect):
    """Inertia that the motors move: on a robot with one joint, only another payload shows it."""

    def motion_for(self, n: int) -> str:
        """Return the advice on the motion that shows the effect on a robot of `n` joints."""
        return PAYLOAD if n == 1 else self.excitation


@dataclass(frozen=True)
class ArmatureEffect(InertiaEffect):
    """Inertia on the motor side."""

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Add the inertia to the plant's motor side."""
        plant.armature[joint] += self.pack(values)[0][0]


@dataclass(frozen=True)
class BodyEffect(InertiaEffect):
    """Inertial parameters of bodies: they belong to the whole robot, and every joint feels them."""

    spread: bool = True
    per_robot: ClassVar[bool] = True


@dataclass(frozen=True)
class PayloadEffect(BodyEffect):
    """Inertial parameters at the last link in addition to the declared payload."""

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Return the regressors (N, n, 10) of the parameters at every joint; zero without a payload."""
        if not signals.carries:
            return np.zeros((*signals.q.shape, len(self.coefficients)))
        return signals.rigid_body.payload_regressor(signals.q, signals.v, signals.a)

    def complexity(self, subset: Iterable[int]) -> int:
        """Return at most 4, for mass and three first moments; a prior determines the other parameters."""
        return min(_BODY, len(list(subset)))

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Add the parameters to the plant's last link."""
        plant.inertials[-1] += self.pack(values)[0]


@dataclass(frozen=True)
class InertialEffect(BodyEffect):
    """Inertial parameters of the links in addition to those of the URDF; their number depends on the robot.

    The names of the parameters of link k, which the k-th joint moves, end in ``_k``, counted from 1. On a
    robot of `n` joints (see `for_robot`) mass and first moments of each link are a variant. All ten
    parameters of a link, and the parameters of all links together, are extensions.

    Attributes
    ----------
    link : tuple of Parameter
        The ten parameters of one link, in the order of `wearscope.robots.spatial`.
    n : int
        Number of joints; 0 before the robot is known.
    """

    link: tuple[Parameter, ...] = ()
    n: int = 0

    @cached_property
    def _sized(self) -> dict[int, Effect]:
        """Effects that `for_robot` has made, by number of joints."""
        return {}

    def for_robot(self, n: int) -> Effect:
        """Return the effect with the coefficients (10 n,) of `n` links."""
        if n == self.n:
            return self
        if n not in self._sized:
            names = [[f"{p.name}_{k + 1}" for p in self.link] for k in range(n)]
            plain, full = [tuple(own[:4]) for own in names], [tuple(own) for own in names]
            extensions = [*full, *([sum(plain, ()), sum(full, ())] if n > 1 else [])]
            self._sized[n] = replace(
                self,
                coefficients=tuple(replace(p, name=f"{p.name}_{k + 1}") for k in range(n) for p in self.link),
                variants=tuple(plain),
                extensions=tuple(extensions),
                n=n,
            )
        return self._sized[n]

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Return the regressors (N, n, 10 n) of the links' inertial parameters at every joint."""
        return signals.rigid_body.inertial_regressor(signals.q, signals.v, signals.a)

    def complexity(self, subset: Iterable[int]) -> int:
        """Return 4 for each link in the subset, and 1 for the choice of the links where there are several."""
        return _BODY * len({k // len(self.link) for k in subset}) + (self.n > 1)

    def torque(self, signals: Signals, joint: int, values: Mapping[str, float]) -> np.ndarray:
        """Return the torque (N, n) along signals for given parameter values."""
        coefficients = self.for_robot(signals.q.shape[1]).pack(values)[0]
        return self.columns(signals, joint, np.zeros(0)) @ coefficients

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Add the parameters to the plant's links."""
        plant.inertials += self.for_robot(plant.n).pack(values)[0].reshape(plant.n, len(self.link))


@dataclass(frozen=True)
class TransmissionEffect(Effect):
    """Deflection of the gear between the measured motor and the link, delta(tau) = coefficient * `bend`(tau).

    The link is behind the motor by delta, and the rigid-body torque is that along the link's motion. So the
    regressor, at every joint, is minus the derivative of inverse dynamics in the direction of `bend`(tau).
    tau is the torque through the gear where it is known, else the rigid-body torque along the motor's motion.
    The deflection of an `abrupt` effect jumps.
    """

    spread: bool = True
    bend: Callable = field(default=lambda torque, shape: torque)
    abrupt: bool = False
    installs: tuple[str, ...] = ()

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Return the regressor (N, n, 1) at every joint."""
        torque = signals.load if signals.transmitted is None else signals.transmitted
        delta = self.bend(torque[:, joint], shape)
        speed = differentiate(delta, 1.0 / signals.dt)
        acceleration = differentiate(speed, 1.0 / signals.dt)
        by_position, by_speed, by_acceleration = signals.load_slopes(joint)
        lag = (
            by_position * delta[:, None] + by_speed * speed[:, None] + by_acceleration * acceleration[:, None]
        )
        return -lag[:, :, None]

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Set the plant's deflection law of the gear."""
        coefficients, shape = self.pack(values)
        for name, value in zip(self.installs, [*coefficients, *shape], strict=True):
            getattr(plant, name)[joint] = value


@dataclass(frozen=True)
class MeasurementEffect(Effect):
    """An error of the recorded torque, with regressors computed from the predicted torque."""

    kind: Literal["gain", "lag"] = "gain"

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Return the regressor (N, 1): the predicted torque; or its change by a delay, over the delay [s]."""
        assert signals.torque is not None
        torque = signals.torque[:, joint]
        if self.kind == "gain":
            return torque[:, None]
        lag = 0.0 if signals.lag is None else float(signals.lag[joint])
        if abs(lag) < 1e-3 * signals.dt:
            return -differentiate(torque, 1.0 / signals.dt)[:, None]
        return (self._delay(signals, joint, lag) / lag)[:, None]

    def least_size(self, signals: Signals) -> float:
        """Return the smallest believable magnitude of the first coefficient: 0 for a gain, a delay in s."""
        return 0.0 if self.kind == "gain" else LEAST_SAMPLES * signals.dt / signals.factor

    def torque(self, signals: Signals, joint: int, values: Mapping[str, float]) -> np.ndarray:
        """Return the change (N,) of the recorded torque; that by a delay is computed as a shift in time."""
        if self.kind == "gain":
            return super().torque(signals, joint, values)
        return self._delay(signals, joint, float(self.pack(values)[0][0]))

    def _delay(self, signals: Signals, joint: int, lag: float) -> np.ndarray:
        """Return the change (N,) of a joint's torque by a delay [s]."""
        # Imported here: every simulation job loads the effects, and none of them needs this import.
        from scipy.interpolate import CubicSpline

        assert signals.torque is not None
        torque, t = signals.torque[:, joint], signals.t
        return np.asarray(CubicSpline(t, torque)(np.clip(t - lag, t[0], t[-1])) - torque)

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Add the gain error or the delay to the plant's recorded torque."""
        target = plant.torque_gain if self.kind == "gain" else plant.torque_delay
        target[joint] += self.pack(values)[0][0]


@dataclass(frozen=True)
class BalancerEffect(Effect):
    """Balancer whose first shape parameter is the position at which its pins are aligned.

    Attributes
    ----------
    step : float
        Of the angles that are tried [rad].
    """

    step: float = 0.0

    def acts_on(self, position_unit: str) -> bool:
        """Return whether the joint turns, as the pins of a balancer do about it."""
        return position_unit == "rad"

    def count_alternatives(self, shapes: int) -> float:
        """Return the number of shapes of which the angles are a quarter turn apart."""
        return shapes * min(1.0, self.step / (np.pi / 2.0))

    def width(self, signals: Signals, joint: int, shape: Sequence[float]) -> float:
        """Return the half width of the search for the angle, in its logarithm [-]."""
        return self.step / float(shape[0])


@dataclass(frozen=True)
class WaveEffect(Effect):
    """Waves over the joint's position, with a wavenumber that is fitted, the first shape parameter.

    The search takes the wavenumbers to try from a spectrum of the residual over position.
    """

    @property
    def repeatable(self) -> bool:
        """Whether a joint can have the effect several times: once for each wavenumber."""
        return True

    def width(self, signals: Signals, joint: int, shape: Sequence[float]) -> float:
        """Return the half width of the search for the wavenumber, in its logarithm [-]."""
        # Two waves can be told apart where they shift by half a period over the visited range.
        travel = max(float(np.ptp(signals.q[:, joint])), 1e-12)
        return min(0.3, np.pi / travel / float(shape[0]))


@dataclass(frozen=True)
class FrictionLaw(Effect):
    """Friction by the paper's eq. (17), whose speed of decay eta3 + eta4 T depends on the temperature T.

    Attributes
    ----------
    parts : tuple of str
        Effects that are a part of this one, and share parameters with it by name.
    """

    parts: tuple[str, ...] = ()

    def temperatures(self, values: Mapping[str, float]) -> tuple[float, float]:
        """Return the range of temperatures [deg C], exclusive, in which eta3 + eta4 T is positive."""
        filled = self.fill(values)
        start, slope = filled["eta3"], filled["eta4"]
        if slope == 0.0:
            return (-np.inf, np.inf) if start > 0.0 else (np.inf, -np.inf)
        return (-start / slope, np.inf) if slope > 0.0 else (-np.inf, -start / slope)
