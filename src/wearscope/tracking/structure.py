"""The reference's fixed structure: its terms along any run, and how temperature may change friction.

The change of a joint's friction with temperature is a Gaussian process with the squared exponential kernel,
written in features about the reference's mean temperature (Rasmussen and Williams 2006, sec. 4.3). At the
temperatures of the reference and a little beyond, its runs determine this function. Elsewhere only the prior
is known, and a change of friction cannot be told from one of temperature.
"""

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.closed_loop.model.joint_flexibility import rigid_link_torque, solve_gears
from wearscope.closed_loop.model.prediction import find_lags, predict_motor
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import Signals
from wearscope.effects.vocabulary import plain_friction
from wearscope.tracking.session_runs import Frame

if TYPE_CHECKING:
    from wearscope.closed_loop.model.regression import Regression

#: Temperature difference [K] over which friction changes its slope: viscosities fall by e in 16 to 40 K.
LENGTH = 25.0
#: Prior standard deviation of the slope, as a share of the joint's friction [1/K].
SLOPE = 0.03
#: Standard deviation [K] of a temperature that was not recorded.
UNRECORDED = 10.0
#: Number of features of a function of temperature: higher orders are negligible within two lengths of the
#: mean.
FEATURES = 8


def temperature_features(temperature: np.ndarray, mean: float) -> np.ndarray:
    """Features (N, k) of a temperature (N,) [deg C], zero at `mean`, whose weights are standard normal.

    Their weighted sum is the change of friction, as a share of the joint's friction.
    """
    x = (temperature - mean) / LENGTH
    bell = np.exp(-0.5 * x**2)
    powers = [bell * x**p / math.sqrt(math.factorial(p)) for p in range(1, FEATURES)]
    return SLOPE * LENGTH * np.column_stack([bell - 1.0, *powers])


@dataclass(frozen=True)
class Scales:
    """Sizes of a healthy machine's joint torques, over the rows that count; each (n,).

    Attributes
    ----------
    friction : ndarray
        RMS of the torque that depends on the speed or its sign.
    torque : ndarray
        RMS of the whole torque.
    speed : ndarray
        RMS speed.
    noise : ndarray
        Standard deviation of the residual, increased by its autocorrelation as for a sum over a block.
    """

    friction: np.ndarray
    torque: np.ndarray
    speed: np.ndarray
    noise: np.ndarray


@dataclass(frozen=True, eq=False)
class Belief:
    """Weights of the structure's columns, estimated from runs of the reference, with their uncertainty.

    Attributes
    ----------
    mean : ndarray (P,)
    covariance : ndarray (P, P)
    """

    mean: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class Structure:
    """Terms of the healthy machine, with fixed shapes.

    Attributes
    ----------
    joints, position_unit, torque_unit : tuple of str
        By joint.
    frame : Frame
    entries : tuple of ModelTerm
    theta : ndarray (P,)
        Parameters for the motors' and the gears' torques, on which errors of the measurement and deflections
        of gears act.
    inertial : bool
        Whether deviations of the inertial parameters come first among the columns.
    temperature : ndarray (n,)
        Mean temperature of each joint in the reference [deg C]; NaN where it was not recorded.
    warmth : ndarray (2, n)
        Lowest and highest temperature in the reference [deg C].
    scales : Scales
    """

    joints: tuple[str, ...]
    position_unit: tuple[str, ...]
    torque_unit: tuple[str, ...]
    frame: Frame
    entries: tuple[ModelTerm, ...]
    theta: np.ndarray
    inertial: bool
    temperature: np.ndarray
    warmth: np.ndarray
    scales: Scales
    spans: list[slice] = field(init=False)

    def __post_init__(self) -> None:
        start, spans = 10 * self.n if self.inertial else 0, []
        for entry in self.entries:
            spans.append(slice(start, start + len(entry.subset)))
            start += len(entry.subset)
        object.__setattr__(self, "spans", spans)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def moving(self) -> np.ndarray:
        """Indices of the joints that move in the reference."""
        return np.flatnonzero(self.frame.moving)

    @property
    def prepared(self) -> "Structure":
        """The structure itself: functions of the closed loop read the number of joints from `prepared`."""
        return self

    @property
    def thermal(self) -> list[int]:
        """Joints whose temperature the reference records."""
        return [j for j in range(self.n) if self.frame.moving[j] and np.isfinite(self.temperature[j])]

    @property
    def count(self) -> int:
        """Number of parameters of the terms."""
        return len(self.theta)

    @property
    def of_temperature(self) -> np.ndarray:
        """Mask (P,) of the columns that are features of the temperature."""
        return np.arange(self.width) >= self.count

    @property
    def width(self) -> int:
        """Number of columns: those of the parameters, then those of each joint's temperature features."""
        return self.count + 2 * FEATURES * len(self.thermal)

    def operate(self, run: PreparedRun) -> Signals:
        """Signals of a run with the load, the motors' and the gears' torque of the healthy machine."""
        model = cast("Regression", self)
        solved = solve_gears(model, self.theta, run)
        load = rigid_link_torque(model, self.theta, run.signals)
        signals = replace(run.signals, load=load, transmitted=solved)
        motor = predict_motor(model, self.theta, run, signals)
        return replace(signals, torque=motor, lag=find_lags(model, self.theta))

    def friction_columns(self, signals: Signals, joint: int) -> tuple[np.ndarray, np.ndarray]:
        """Torque (N,) of Coulomb and of viscous friction, each with the RMS of the joint's whole friction."""
        size = self.scales.friction[joint]
        return size * signals.sign[:, joint], size / self.scales.speed[joint] * signals.v[:, joint]

    def other_friction(self, signals: Signals, joint: int) -> np.ndarray:
        """Torque (N,) of the joint's friction that is neither Coulomb nor viscous, as in the reference."""
        plain, torque = [effect.name for effect in plain_friction()], np.zeros(len(signals.t))
        for entry, span in zip(self.entries, self.spans, strict=True):
            if entry.joint == joint and entry.effect.is_friction and entry.effect.name not in plain:
                torque = torque + entry.columns(signals)[:, joint] @ self.theta[span]
        return torque

    def place(self, joint: int, columns: np.ndarray) -> np.ndarray:
        """Columns (N, p) of one joint's torque as regressors (N, n, p)."""
        placed = np.zeros((len(columns), self.n, columns.shape[1]))
        placed[:, joint] = columns
        return placed

    def columns(self, signals: Signals) -> np.ndarray:
        """Full-rate regressors (N, n, width); a temperature that was not recorded is taken as the mean."""
        parts = []
        if self.inertial:
            s = signals
            parts.append(s.rigid_body.inertial_regressor(s.q, s.v, s.a))
        parts += [entry.columns(signals) for entry in self.entries]
        for j in self.thermal:
            warmth = signals.temperature[:, j]
            known = np.where(np.isfinite(warmth), warmth, self.temperature[j])
            features = temperature_features(known, float(self.temperature[j]))
            parts += [self.place(j, features * one[:, None]) for one in self.friction_columns(signals, j)]
        if not parts:
            return np.zeros((len(signals.t), self.n, 0))
        return np.concatenate(parts, axis=2)

    def unrecorded_columns(self, signals: Signals) -> np.ndarray:
        """Regressors (N, n, u) of temperatures that were not recorded; their weights are standard normal."""
        parts = [np.zeros((len(signals.t), self.n, 0))]
        for j in range(self.n):
            if not self.frame.moving[j]:
                continue
            if np.isfinite(self.temperature[j]) and np.isfinite(signals.temperature[:, j]).all():
                continue
            own = (*self.friction_columns(signals, j), self.other_friction(signals, j))
            parts += [self.place(j, SLOPE * UNRECORDED * one[:, None]) for one in own if one.any()]
        return np.concatenate(parts, axis=2)
