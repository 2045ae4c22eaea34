"""Joint estimate of wear, temperature and payload error under the declared friction law (detector D)."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wearscope.detectors.base import Array, Batch, check_nominal
from wearscope.detectors.motion import (
    compute_joint_residual,
    compute_payload_torque,
    compute_rigid_torque,
    estimate_acceleration,
)
from wearscope.effects.base import Effect, Signals, load_effect

FRICTION_LAW = "friction_wear_temperature"
SPEED_ONLY = {"qd_{joint}", "sign_qd_{joint}", "temp_{joint}", "wear_{joint}"}
# Nodes of the friction torque over speed, in each direction.
NODES = 64
# Of the search for f [-] and T [deg C]: difference steps, the change at which it ends, and what counts as
# not told apart: the share of a slope that offset and payload leave, the condition of the normal equations.
STEPS = np.diag([0.5, 0.25])
TOLERANCE = 1e-4
MIN_SHARE = 1e-6
MAX_CONDITION = 1e8
MAX_DAMPING = 1e8


@dataclass
class WearTemperatureFit:
    r"""Wear level f estimated together with the temperature T of the declared friction law.

    .. math:: \min_{f, T, \beta, \mu} \sum_k (r_k - \tau_f(v_k, T, f) - \beta - \mu \, \tau_{p,k})^2

    over the samples in motion: r is the residual of the tested axis (recorded torque minus inverse dynamics
    with the declared payload, rotor inertia and the other declared effects), :math:`\tau_f` the declared
    eq. (17) of Samuelsson et al. (2014), :math:`\beta` an offset, :math:`\tau_p` the torque of the declared
    payload, whose relative mass error :math:`\mu` is estimated along. The linear unknowns are projected out,
    f and T found by damped Gauss-Newton (Golub, Pereyra, SIAM J. Numer. Anal. 10, 1973; Marquardt, 1963).
    The test quantity is f less its estimate on nominal data [-]; negative estimates extend eq. (17) oddly
    in f, so that noise around no wear is not clipped.

    Wear and temperature part only where the motion visits the low and the high speed band. The detector
    knows the friction law with its parameters, as identified for the robot; where that law is also the
    simulator's, its result is a bound for what a friction model can give, not what it gives in the field.

    After Bittencourt, Axelsson, Modeling and experiment design for identification of wear in a robot joint
    under load and temperature uncertainties based on friction data, IEEE/ASME Trans. Mechatronics 19 (2014).

    Parameters
    ----------
    estimate_payload : bool
        Whether :math:`\mu` is estimated.
    start_temperature : float
        Where the search starts [deg C]. It starts anew where wear and temperature have traded the speeds of
        their low-speed terms, the one local minimum that eq. (17) invites; the better fit is taken.
    temperature_limit : float
        Highest temperature searched [deg C]; the lowest is where the declared Stribeck speed falls to 1 % of
        its value at `start_temperature`, or `start_temperature` less 100.
    rest_share : float
        Speed under which a sample counts as at rest, as share of the 99 % quantile of the nominal speed.
    window : float
        Length of the acceleration filter [s].
    max_iterations : int
    """

    estimate_payload: bool = True
    start_temperature: float = 50.0
    temperature_limit: float = 150.0
    rest_share: float = 0.01
    window: float = 0.03
    max_iterations: int = 60
    axis: int = field(default=0, init=False)
    model: Any = field(default=None, init=False, repr=False)
    law: dict[str, float] = field(default_factory=dict, init=False, repr=False)
    rest_speed: float = field(default=0.0, init=False)
    lowest: float = field(default=0.0, init=False)
    nominal_wear: float = field(default=0.0, init=False)
    varying: list[tuple[Effect, dict[str, float]]] = field(default_factory=list, init=False, repr=False)
    steady: list[tuple[Effect, dict[str, float]]] = field(default_factory=list, init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("rest_share", "window", "max_iterations"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive")
        if not self.temperature_limit > self.start_temperature:
            raise ValueError("temperature_limit must be above start_temperature")

    def fit(self, nominal: Sequence[Batch], axis: int, model: Any) -> None:
        """Read the declared friction law of the axis and estimate the wear of the nominal batches."""
        check_nominal(nominal)
        self.axis, self.model = axis, model
        joint = model.joints[axis]
        entries = [entry for entry in model.effects if entry.joint == joint]
        laws = [entry.parameters for entry in entries if entry.effect == FRICTION_LAW]
        if len(laws) != 1:
            raise ValueError(f"the model declares {len(laws)} effects {FRICTION_LAW} at {joint}, 1 is needed")
        self.law = dict(laws[0])
        self.lowest = self._lowest_temperature()
        self.varying, self.steady = [], []
        for entry in entries:
            effect = load_effect(entry.effect)
            if effect.row is None:
                continue
            changes = {"temp_{joint}", "wear_{joint}"} & set(effect.depends_on)
            if changes and not set(effect.depends_on) <= SPEED_ONLY:
                raise ValueError(f"{entry.effect} depends on more than speed, temperature and wear")
            (self.varying if changes else self.steady).append((effect, entry.parameters))
        speed = np.abs(np.concatenate([batch.qd[:, axis] for batch in nominal]))
        self.rest_speed = self.rest_share * float(np.quantile(speed, 0.99))
        if not self.rest_speed > 0:
            raise ValueError("the tested axis does not move in the nominal data")
        self.nominal_wear = float(np.mean([self.estimate(batch)[0] for batch in nominal]))

    def _lowest_temperature(self) -> float:
        start, slope = self.law.get("eta3", 0.0), self.law.get("eta4", 0.0)
        at_start = start + slope * self.start_temperature
        if not at_start > 0:
            raise ValueError(
                f"the declared Stribeck speed is {at_start:g} at {self.start_temperature:g} deg C, not > 0"
            )
        if slope < 0:
            raise ValueError("the declared Stribeck speed falls with temperature")
        lowest = self.start_temperature - 100.0
        return max(lowest, (0.01 * at_start - start) / slope) if slope > 0 else lowest

    def estimate(self, batch: Batch) -> tuple[float, float]:
        """Wear level f [-] and temperature T [deg C] of a batch.

        Raises
        ------
        ValueError
            Where the axis moves too little or the motion does not tell the two apart.
        """
        moving = np.flatnonzero(np.abs(batch.qd[:, self.axis]) > self.rest_speed)
        if len(moving) < 20:
            raise ValueError(f"the tested axis moves in {len(moving)} samples only")
        residual = compute_joint_residual(batch, self.model, self.axis, self.window)
        if self.steady:
            signals = self._make_signals(batch)
            residual = residual - sum(effect.torque(signals, self.axis, p) for effect, p in self.steady)
        columns = [np.ones(len(moving))]
        payload = compute_payload_torque(batch, self.model, self.window) if self.estimate_payload else None
        if payload is not None:
            columns.append(payload[moving, self.axis])
        basis = _orthonormal(np.column_stack(columns))

        def project(torque: Array) -> Array:
            return torque - basis @ (basis.T @ torque)

        table = _SpeedTable(batch.qd[moving, self.axis], self.rest_speed)

        def friction(x: Array) -> Array:
            return table.interpolate(self._evaluate_friction(table.nodes, x))

        task = (residual[moving], friction, project)
        x, cost = self._minimise(np.array([1.0, self.start_temperature]), *task)
        traded = self._trade_speeds(x)
        if traded is not None:
            with suppress(ValueError):  # where this search finds nothing, the first one holds
                other, other_cost = self._minimise(traded, *task)
                if other_cost < cost:
                    x = other
        return float(x[0]), float(x[1])

    def _trade_speeds(self, x: Array) -> Array | None:
        """Wear and temperature whose low-speed terms have each other's speeds, None without such terms."""
        start, slope, wear_slope = (self.law.get(name, 0.0) for name in ("eta3", "eta4", "eta8"))
        if slope <= 0 or wear_slope <= 0 or x[0] <= 0:
            return None
        temperature = (wear_slope * x[0] - start) / slope
        wear = (start + slope * x[1]) / wear_slope
        return np.array([wear, np.clip(temperature, self.lowest, self.temperature_limit)])

    def _make_signals(self, batch: Batch) -> Signals:
        unknown = np.zeros_like(batch.q)
        return Signals(
            batch.t, batch.q, batch.qd, estimate_acceleration(batch, self.window), np.sign(batch.qd),
            compute_rigid_torque(batch, self.model, self.window), unknown, unknown,
        )  # fmt: skip

    def _evaluate_friction(self, speed: Array, x: Array) -> Array:
        """Torque (m, K) at speeds (K,) and wears and temperatures `x` (m, 2), odd in the wear.

        It is that of the declared effects which wear or temperature change.
        """
        levels = np.vstack([x * (0.0, 1.0), np.column_stack([np.abs(x[:, 0]), x[:, 1]])])
        samples = np.repeat(levels, len(speed), axis=0)
        shape = (len(samples), self.model.n)
        at_rest, v = np.zeros(shape), np.zeros(shape)
        v[:, self.axis] = np.tile(speed, len(levels))
        wear, temperature = (np.tile(column[:, None], shape[1]) for column in samples.T)
        t = np.arange(len(samples), dtype=float)
        signals = Signals(t, at_rest, v, at_rest, np.sign(v), at_rest, temperature, wear)
        torque = np.zeros(len(samples))
        for effect, values in self.varying:
            torque += effect.torque(signals, self.axis, values)
        unworn, worn = torque.reshape(2, len(x), len(speed))
        return unworn + np.sign(x[:, :1]) * (worn - unworn)

    def _minimise(
        self,
        start: Array,
        residual: Array,
        friction: Callable[[Array], Array],
        project: Callable[[Array], Array],
    ) -> tuple[Array, float]:
        """Damped Gauss-Newton on f and T (2,) with difference quotients; T is kept in its range.

        Returns the place and the sum of squares there.
        """
        low, high = np.array([-np.inf, self.lowest]), np.array([np.inf, self.temperature_limit])
        x = start
        misfit = project(residual - friction(x[None])[0])
        cost, damping = float(misfit @ misfit), 1e-3
        for _ in range(self.max_iterations):
            ahead, behind = np.minimum(x + STEPS, high), np.maximum(x - STEPS, low)
            values = friction(np.concatenate([ahead, behind]))
            slopes = ((values[:2] - values[2:]) / np.sum(ahead - behind, axis=1)[:, None]).T
            jacobian = -project(slopes)
            normal, gradient = jacobian.T @ jacobian, jacobian.T @ misfit
            size = np.sqrt(np.diag(normal))
            seen = size > MIN_SHARE * np.linalg.norm(slopes, axis=0)
            if not (seen.all() and np.linalg.cond(normal / np.outer(size, size)) < MAX_CONDITION):
                raise ValueError("the motion of the tested axis does not tell wear and temperature apart")
            # An unknown at its bound that the gradient pushes outward stays there.
            free = ~(((x <= low) & (gradient > 0)) | ((x >= high) & (gradient < 0)))
            part = normal[np.ix_(free, free)]
            moved = np.zeros(2)
            while damping < MAX_DAMPING:
                trial = x.copy()
                trial[free] -= np.linalg.solve(part + damping * np.diag(np.diag(part)), gradient[free])
                trial = np.clip(trial, low, high)
                misfit_there = project(residual - friction(trial[None])[0])
                cost_there = float(misfit_there @ misfit_there)
                if cost_there <= cost:
                    moved = trial - x
                    x, misfit, cost, damping = trial, misfit_there, cost_there, max(damping / 10, 1e-9)
                    break
                damping *= 10
            if np.all(np.abs(moved) < TOLERANCE):
                return x, cost
        raise ValueError(f"no wear and temperature found in {self.max_iterations} iterations")

    def test_quantity(self, batch: Batch) -> float:
        """Estimated wear level less that of the nominal data [-]."""
        return self.estimate(batch)[0] - self.nominal_wear


class _SpeedTable:
    """Linear interpolation of a function of speed from nodes, geometric in each direction, to samples.

    Between nodes a ratio r apart, exp(-v/s) is missed by at most 0.07 (r - 1)^2, 4e-4 here.
    """

    def __init__(self, speed: Array, rest_speed: float) -> None:
        half = np.geomspace(rest_speed, max(np.abs(speed).max(), 2 * rest_speed), NODES)
        self.nodes = np.concatenate([-half[::-1], half])
        left = np.clip(np.searchsorted(self.nodes, speed) - 1, 0, len(self.nodes) - 2)
        self.left = left
        self.share = (speed - self.nodes[left]) / (self.nodes[left + 1] - self.nodes[left])

    def interpolate(self, values: Array) -> Array:
        """Values (m, N) at the samples of values (m, K) at the nodes."""
        left = values[:, self.left]
        return left + self.share * (values[:, self.left + 1] - left)


def _orthonormal(columns: Array) -> Array:
    """Orthonormal basis (N, k) of the columns, those that add nothing left out."""
    left, values, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return left[:, values > 1e-8 * values[0]]


DETECTOR = WearTemperatureFit
