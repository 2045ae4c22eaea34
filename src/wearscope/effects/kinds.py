"""Effects that are more than a torque of the joint's own motion."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from wearscope.effects.effect import Effect
from wearscope.effects.parameter import Parameter
from wearscope.effects.rows import Plant
from wearscope.effects.signals import Signals, differentiate

#: Values that describe a body for gravity: its mass and first moments.
_BODY = 4


@dataclass(frozen=True)
class RigidBodyEffect(Effect):
    """The multibody dynamics themselves; the plant always has them."""

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Regressors of the inertial parameters at a joint, (N, 10 n)."""
        return signals.rigid_body.inertial_regressor(signals.q, signals.v, signals.a)[:, joint, :]

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Nothing to add."""


@dataclass(frozen=True)
class ArmatureEffect(Effect):
    """Inertia on the motor side."""

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Add to the armature."""
        plant.armature[joint] += self.pack(values)[0][0]


@dataclass(frozen=True)
class PayloadEffect(Effect):
    """Mass at the last link beyond the declared payload; regressors are those of the rigid body."""

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Regressors of the inertial parameters at every joint, (N, n, 10); zero without a payload."""
        if not signals.carries:
            return np.zeros((*signals.q.shape, len(self.coefficients)))
        return signals.rigid_body.payload_regressor(signals.q, signals.v, signals.a)

    def complexity(self, subset: Iterable[int]) -> int:
        """One body, however many of its parameters a prior lets a fit choose: a mass and three moments."""
        return _BODY

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Add to the last link."""
        plant.inertials[-1] += self.pack(values)[0]


@dataclass(frozen=True)
class InertialEffect(Effect):
    """Inertial parameters of every link beyond those of the URDF; its coefficients depend on the robot.

    Those of link k, which the k-th joint moves, end in ``_k``, counted from 1. On a robot of `n` joints
    (`for_robot`) the links' masses and first moments are a variant each; with inertias, and for all links at
    once, they are extensions.

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
        return {}

    def for_robot(self, n: int) -> Effect:
        """The effect with the coefficients of `n` links, (10 n,)."""
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
        """Regressors of the links' inertial parameters at every joint, (N, n, 10 n)."""
        return signals.rigid_body.inertial_regressor(signals.q, signals.v, signals.a)

    def complexity(self, subset: Iterable[int]) -> int:
        """One body for each link concerned, and which of them it is."""
        return _BODY * len({k // len(self.link) for k in subset}) + 1

    def torque(self, signals: Signals, joint: int, values: Mapping[str, float]) -> np.ndarray:
        """Torque (N, n) along signals for given parameter values."""
        coefficients = self.for_robot(signals.q.shape[1]).pack(values)[0]
        return self.columns(signals, joint, np.zeros(0)) @ coefficients

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Add to the links."""
        plant.inertials += self.for_robot(plant.n).pack(values)[0].reshape(plant.n, len(self.link))


@dataclass(frozen=True)
class TransmissionEffect(Effect):
    """Deflection of the gear between motor (measured) and link, delta(tau) = coefficient * `bend`(tau).

    The link lags the motor by delta; its torque is that of the rigid body along the link's motion, so that
    the regressor is the derivative of inverse dynamics along the deflection, at every joint. tau is the
    torque through the gear where it is known, else that of the rigid body along the motor's motion. The
    deflection of an `abrupt` one jumps.
    """

    bend: Callable = field(default=lambda torque, shape: torque)
    abrupt: bool = False
    installs: tuple[str, ...] = ()

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Regressor at every joint, (N, n, 1)."""
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
        """Set the transmission's deflection law."""
        coefficients, shape = self.pack(values)
        for name, value in zip(self.installs, [*coefficients, *shape], strict=True):
            getattr(plant, name)[joint] = value


@dataclass(frozen=True)
class MeasurementEffect(Effect):
    """An error of the recorded torque; regressors are made from the predicted torque."""

    kind: Literal["gain", "lag"] = "gain"

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Regressor, (N, 1): the predicted torque, or its change by a delay, per delay."""
        assert signals.torque is not None
        torque = signals.torque[:, joint]
        if self.kind == "gain":
            return torque[:, None]
        lag = 0.0 if signals.lag is None else float(signals.lag[joint])
        if abs(lag) < 1e-3 * signals.dt:
            return -differentiate(torque, 1.0 / signals.dt)[:, None]
        return (self._delay(signals, joint, lag) / lag)[:, None]

    def torque(self, signals: Signals, joint: int, values: Mapping[str, float]) -> np.ndarray:
        """Change (N,) of the recorded torque for given parameter values: that by a delay is a shift."""
        if self.kind == "gain":
            return super().torque(signals, joint, values)
        return self._delay(signals, joint, float(self.pack(values)[0][0]))

    def _delay(self, signals: Signals, joint: int, lag: float) -> np.ndarray:
        """What a delay changes in the torque of a joint (N,)."""
        # Imported here: every simulation job loads the effects, and none needs it.
        from scipy.interpolate import CubicSpline

        assert signals.torque is not None
        torque, t = signals.torque[:, joint], signals.t
        return np.asarray(CubicSpline(t, torque)(np.clip(t - lag, t[0], t[-1])) - torque)

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Set the recording's gain error or lag."""
        target = plant.torque_gain if self.kind == "gain" else plant.torque_delay
        target[joint] += self.pack(values)[0][0]
