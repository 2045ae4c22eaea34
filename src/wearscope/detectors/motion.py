"""Signals that detectors derive from a recording, computed once a batch."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import lstsq
from scipy.ndimage import convolve1d

from wearscope.detectors.base import Array, Batch

if TYPE_CHECKING:
    from wearscope.robots.model import RobotModel

PAYLOAD_STEP = 0.01


def find_top_speed(nominal: Sequence[Batch], axis: int) -> float:
    """99 % quantile of the nominal speed magnitude of an axis, counted from 0.

    Raises
    ------
    ValueError
        Where the axis stands still.
    """
    speed = np.abs(np.concatenate([batch.qd[:, axis] for batch in nominal]))
    top_speed = float(np.quantile(speed, 0.99))
    if not top_speed > 0:
        raise ValueError("the tested axis does not move in the nominal data")
    return top_speed


def estimate_acceleration(batch: Batch, window: float = 0.03) -> Array:
    """Joint acceleration by a zero-phase filter of the recorded speed.

    Parameters
    ----------
    batch : Batch
    window : float
        Length of the filter [s], widened to 5 samples where they take longer.

    Returns
    -------
    array (N, n)
        Derivative of the local least-squares parabola of `qd` (Savitzky and Golay, Anal. Chem. 36, 1964),
        symmetric about its sample, hence without lag.

    Raises
    ------
    ValueError
        Where the batch is shorter than the filter.
    """
    key = ("acceleration", window)
    if key not in batch.derived:
        half = max(2, round(0.5 * window * batch.sample_rate))
        length = 2 * half + 1
        if length > len(batch.t):
            raise ValueError(f"the batch has {len(batch.t)} samples, the acceleration needs {length}")
        batch.derived[key] = differentiate_locally(batch.qd, length, 1.0 / batch.sample_rate)
    return batch.derived[key]


def differentiate_locally(values: Array, length: int, delta: float) -> Array:
    """Derivative of least-squares parabolas of `length` samples; the ends use the first and last parabola.

    As ``scipy.signal.savgol_filter(values, length, 2, deriv=1, delta=delta, axis=0)``, to the last bit;
    importing that takes as long as the detectors of some recordings.

    Parameters
    ----------
    values : array (N, n)
    length : int
        Odd.
    delta : float
        Sampling interval [s].

    Returns
    -------
    array (N, n)
    """
    values = np.asarray(values, dtype=float)
    half = length // 2
    at = np.arange(-half, length - half, dtype=float)[::-1]
    powers = at ** np.arange(3.0)[:, None]
    weights = _solve_least_squares(powers, np.array([0.0, 1.0 / delta, 0.0]))
    slope = convolve1d(values, weights, axis=0, mode="constant")
    count = len(values)
    at = np.arange(length, dtype=float)
    slope[:half] = _slope_of_parabola(values[:length], at[:half]) / delta
    slope[count - half :] = _slope_of_parabola(values[count - length :], at[half + 1 :]) / delta
    return slope


def _solve_least_squares(matrix: Array, right: Array) -> Array:
    return np.asarray(lstsq(matrix, right, cond=np.finfo(float).eps * max(matrix.shape))[0])


def _slope_of_parabola(values: Array, at: Array) -> Array:
    """Slope per sample, at samples `at`, of the least-squares parabola through all `values` (M, n)."""
    powers = np.arange(len(values), dtype=float)[:, None] ** np.array([2.0, 1.0, 0.0])
    scale = np.sqrt(np.sum(powers * powers, axis=0))
    square, linear, _ = (_solve_least_squares(powers / scale, values).T / scale).T
    return 2.0 * square * at[:, None] + linear


def compute_rigid_torque(batch: Batch, model: "RobotModel", window: float) -> Array:
    """Inverse dynamics with the declared payload along the recorded motion, without rotors.

    Parameters
    ----------
    batch : Batch
    model : RobotModel
    window : float
        Of `estimate_acceleration` [s].

    Returns
    -------
    array (N, n)
        [N m] or [N].
    """
    # The key holds the model itself: an id alone may be that of a model already gone.
    key = ("rigid_torque", id(model), window)
    if key not in batch.derived:
        body = model.rigid_body(model.declared_payload)
        torque = body.inverse_dynamics(batch.q, batch.qd, estimate_acceleration(batch, window))
        batch.derived[key] = (model, torque)
    return batch.derived[key][1]


def compute_payload_torque(batch: Batch, model: "RobotModel", window: float) -> Array | None:
    """Torque of the declared payload, the derivative by its relative mass error.

    Mass and inertia scale together, the centre of mass stays.

    Returns
    -------
    array (N, n) or None
        None where the model declares no payload.
    """
    payload = model.declared_payload
    if payload is None or payload.mass == 0.0:
        return None
    key = ("payload_torque", id(model), window)
    if key not in batch.derived:
        body = model.rigid_body(payload.scaled(1.0 + PAYLOAD_STEP))
        torque = body.inverse_dynamics(batch.q, batch.qd, estimate_acceleration(batch, window))
        # Inverse dynamics are linear in the inertial parameters, so the quotient is exact.
        batch.derived[key] = (model, (torque - compute_rigid_torque(batch, model, window)) / PAYLOAD_STEP)
    return batch.derived[key][1]


def compute_joint_residual(batch: Batch, model: "RobotModel", axis: int, window: float) -> Array:
    """Torque left to friction: recorded minus rigid body minus declared rotor inertia, (N,).

    Parameters
    ----------
    batch : Batch
    model : RobotModel
    axis : int
        Counted from 0.
    window : float
        Of `estimate_acceleration` [s].

    Raises
    ------
    ValueError
        Where a sample is not finite.
    """
    rotor = model.rotor_inertia[axis] * estimate_acceleration(batch, window)[:, axis]
    residual = batch.tau[:, axis] - compute_rigid_torque(batch, model, window)[:, axis] - rotor
    if not np.isfinite(residual).all():
        raise ValueError("the batch holds samples that are not finite")
    return residual
