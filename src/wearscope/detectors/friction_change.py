"""Change of the axis's friction, estimated as in tracking (detector E of the default study)."""

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic.dataclasses import dataclass

from wearscope.detectors.base import (
    OPTIONS,
    Array,
    Batch,
    Positive,
    check_nominal,
    compute_joint_residual,
    compute_payload_torque,
    find_top_speed,
)

#: Coulomb and viscous friction are not identifiable where the nuisances leave less than this share of the
#: squared norm of a regressor.
_ABSORBED = 1e-9


class Rows(NamedTuple):
    """Rows of a batch in motion: target torque (R,), regressors, and the first row of each block.

    The regressors are those of the nominal friction, `base` (R, P), of the payload's mass error, `load`
    (R, 0 or 1), and of the change of friction, `columns` (R, 2).
    """

    target: Array
    base: Array
    load: Array
    columns: Array
    starts: np.ndarray[Any, np.dtype[np.intp]]


@dataclass(config=OPTIONS)
class FrictionChange:
    r"""Mean rise of the friction torque since the nominal batches, estimated as in tracking.

    The nominal batches are the reference, and a batch is a session. The batch's torque minus that of the
    rigid body, the declared rotor inertia and the nominal friction (Coulomb, low-speed bump, viscous, offset)
    is

    .. math:: r = \Delta_c \, s + \Delta_v \, v + C b + e, \quad s = sign(v)

    with the changes of Coulomb and viscous friction, the errors b of the nominal friction and of the declared
    payload as random effects, and autocorrelated noise e. The changes are estimated by generalised least
    squares (Henderson 1975, Biometrics 31) from means over a few samples in motion. The test quantity is

    .. math:: y = \Delta_c \, \overline{|s|} + \Delta_v \, \overline{|v|}

    with the means over the nominal motion. As in tracking without a thermometer, a change of temperature
    changes the friction too; here it is part of the scatter of y.

    Parameters
    ----------
    payload_error : float
        Standard deviation of the payload's relative mass error.
    low_speed_share, rest_share : float
        Speed over which the low-speed bump decays, and speed below which a sample counts as at rest, as
        shares of the 99 % quantile of the nominal absolute speed.
    row, block : float
        Time over which samples are averaged, and time over which noise may be autocorrelated [s].
    window : float
        Length of the acceleration filter [s].
    """

    payload_error: Positive = 0.1
    low_speed_share: Positive = 0.1
    rest_share: Positive = 0.01
    row: Positive = 0.02
    block: Positive = 0.5
    window: Positive = 0.03
    unit: ClassVar[str] = "torque"
    knows: ClassVar[str] = "nominal model"

    def fit(self, nominal: Sequence[Batch], axis: int, model: Any) -> None:
        """Estimate the nominal friction, its uncertainty and the noise."""
        check_nominal(nominal)
        self.axis, self.model = axis, model
        self.top_speed = find_top_speed(nominal, axis)
        self.noise = 1.0
        made = [self.make_rows(batch) for batch in nominal]
        x, y = np.concatenate([r.base for r in made]), np.concatenate([r.target for r in made])
        scale = np.linalg.norm(x, axis=0)
        if len(y) <= x.shape[1] or not np.all(scale > 0):
            raise ValueError("the motion of the tested axis does not show its friction")
        inverse = np.linalg.pinv(x.T @ x / np.outer(scale, scale), rcond=1e-10) / np.outer(scale, scale)
        mean = inverse @ (x.T @ y)
        left = [r.target - r.base @ mean for r in made]
        sums = [
            np.add.reduceat(r.base * e[:, None], r.starts, axis=0) for r, e in zip(made, left, strict=True)
        ]
        every = np.concatenate(sums)
        meat = every.T @ every
        apart = np.sum(
            [((r.base * e[:, None]) ** 2).sum(axis=0) for r, e in zip(made, left, strict=True)], axis=0
        )
        memory = max(float(np.max(np.diag(meat) / np.maximum(apart, 1e-300))), 1.0)
        self.noise = float(np.sqrt(np.mean(np.concatenate(left) ** 2) * memory)) or 1.0
        self.mean, self.covariance = mean, inverse @ meat @ inverse
        columns = np.concatenate([r.columns for r in made])
        self.mean_columns = np.abs(columns).mean(axis=0)

    def make_rows(self, batch: Batch) -> Rows:
        """Average a batch in motion to rows, in units of the noise's standard deviation.

        Raises
        ------
        ValueError
            Where the axis moves too little.
        """
        step = max(1, round(self.row * batch.sample_rate))

        def pool(x: Array) -> Array:
            rows = len(x) // step
            return np.asarray(x[: rows * step].reshape(rows, step, -1).mean(axis=1))

        v = batch.qd[:, self.axis]
        s = np.sign(v)
        moving = pool((np.abs(v) > self.rest_share * self.top_speed).astype(float))[:, 0] == 1.0
        if moving.sum() < 20:
            raise ValueError(f"the tested axis moves for {moving.sum() * self.row:.2g} s only")
        bump = s * np.exp(-np.abs(v) / (self.low_speed_share * self.top_speed))
        target = pool(compute_joint_residual(batch, self.model, self.axis, self.window))[moving, 0]
        base = pool(np.column_stack([s, bump, v, np.ones_like(v)]))[moving]
        columns = pool(np.column_stack([s, v]))[moving]
        payload = compute_payload_torque(batch, self.model, self.window)
        load = np.zeros((len(target), 0))
        if payload is not None:
            load = self.payload_error * pool(payload[:, [self.axis]])[moving]
        length = max(1, round(self.block * batch.sample_rate / step))
        starts = np.unique(np.searchsorted(np.flatnonzero(moving), np.arange(0, len(moving), length)))
        w = 1.0 / self.noise
        return Rows(target * w, base * w, load * w, columns * w, starts[starts < len(target)])

    def test_quantity(self, batch: Batch) -> float:
        """Return the mean rise of the friction torque along the nominal motion [N m or N].

        Raises
        ------
        ValueError
            Where the motion does not show Coulomb and viscous friction.
        """
        rows = self.make_rows(batch)
        nuisance = np.concatenate([rows.base, rows.load], axis=1)
        covariance = np.eye(nuisance.shape[1])
        covariance[: len(self.mean), : len(self.mean)] = self.covariance
        gram = nuisance.T @ nuisance
        # This is (G + V^-1)^-1, computed without the inverse of the covariance V, which may be singular.
        inverse = np.linalg.inv(np.eye(len(gram)) + covariance @ gram) @ covariance
        clean = rows.columns - nuisance @ (inverse @ (nuisance.T @ rows.columns))
        inner, plain = rows.columns.T @ clean, (rows.columns**2).sum(axis=0)
        if np.any(np.diag(inner) <= _ABSORBED * plain):
            raise ValueError("the motion of the tested axis does not show its friction")
        value = np.linalg.pinv(inner, rcond=1e-10) @ (clean.T @ (rows.target - rows.base @ self.mean))
        return float(value @ self.mean_columns)


DETECTOR = FrictionChange
