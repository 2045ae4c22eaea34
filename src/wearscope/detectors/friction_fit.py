"""Friction parameters estimated from the rigid-body residual (detector C of the default study)."""

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from pydantic.dataclasses import dataclass

from wearscope.detectors.base import (
    OPTIONS,
    Array,
    Batch,
    Positive,
    check_nominal,
    compute_joint_residual,
    find_top_speed,
)


@dataclass(config=OPTIONS)
class FrictionFit:
    r"""Rise of the friction curve, from friction parameters estimated by least squares.

    The residual of the tested axis, recorded torque minus inverse dynamics with the declared payload minus
    declared rotor inertia times acceleration, is fitted over the samples in motion by

    .. math:: r = \beta_c \, s + \beta_l \, s \, e^{-|v| / v_l} + \beta_v \, v + \beta_0, \quad s = sign(v)

    (Coulomb, low-speed bump, viscous, offset). The test quantity weighs the change of each friction parameter
    by the mean of its regressor over the speed range 0 to :math:`v_m` of the nominal motion,

    .. math:: y = \sum_k a_k \, \overline{\phi_k} \, (\beta_k - \beta_k^{nominal})

    so that with :math:`a_k = 1` it is the mean rise of the estimated friction curve [N m]. Wear raises
    friction at every speed, in eq. (17) of Samuelsson et al. (2014) by its low-speed and viscous terms, so
    that y rises with wear. All speeds have the same weight, however long the motion stays at them. The reason
    is temperature: in a warmer joint low-speed friction rises and viscous friction falls. A mean over the
    motion's own, mostly low, speeds would show the rise alone. The offset absorbs the mean load error; load
    errors that do not follow sign(v) largely cancel.

    A stand-in for FDA C of Samuelsson et al. (2014). Least squares on inverse dynamics: Gautier, Khalil,
    Restrepo, Identification of the dynamic parameters of a closed loop robot, ICRA 1995; friction features:
    Bittencourt, Gunnarsson, Static friction in a robot joint, ASME J. Dyn. Syst. Meas. Control 134 (2012).

    Parameters
    ----------
    weights : sequence of 3 float
        Weights a of the Coulomb, low-speed and viscous parameters.
    low_speed_share, rest_share : float
        :math:`v_l`, and the speed below which a sample counts as at rest, as shares of :math:`v_m`, the 99 %
        quantile of the nominal absolute speed.
    window : float
        Length of the acceleration filter [s].
    """

    weights: tuple[float, float, float] = (1.0, 1.0, 1.0)
    low_speed_share: Positive = 0.1
    rest_share: Positive = 0.01
    window: Positive = 0.03
    unit: ClassVar[str] = "torque"
    knows: ClassVar[str] = "nominal model"

    def fit(self, nominal: Sequence[Batch], axis: int, model: Any) -> None:
        """Estimate the nominal friction parameters as the mean over the nominal batches."""
        check_nominal(nominal)
        self.axis, self.model = axis, model
        self.top_speed = find_top_speed(nominal, axis)
        share = self.low_speed_share
        self.mean_regressors = np.array([1.0, share * (1.0 - np.exp(-1.0 / share)), 0.5 * self.top_speed])
        self.nominal = np.mean([self.estimate_parameters(batch) for batch in nominal], axis=0)

    def evaluate_regressors(self, speed: Array) -> Array:
        """Return the regressors (N, 4) at speeds (N,): Coulomb, low-speed, viscous, offset."""
        direction = np.sign(speed)
        bump = direction * np.exp(-np.abs(speed) / (self.low_speed_share * self.top_speed))
        return np.column_stack([direction, bump, speed, np.ones_like(speed)])

    def estimate_parameters(self, batch: Batch) -> Array:
        """Estimate the Coulomb, low-speed and viscous parameters (3,) [N m, N m, N m s/rad].

        Raises
        ------
        ValueError
            Where the axis moves too little, or in one direction only, so that they are not identifiable.
        """
        speed = batch.qd[:, self.axis]
        residual = compute_joint_residual(batch, self.model, self.axis, self.window)
        moving = np.abs(speed) > self.rest_share * self.top_speed
        regressors = self.evaluate_regressors(speed[moving])
        scale = np.linalg.norm(regressors, axis=0)
        if len(regressors) < 20 or not np.all(scale > 0):
            raise ValueError(f"the tested axis moves in {len(regressors)} samples only")
        solution, _, rank, _ = np.linalg.lstsq(regressors / scale, residual[moving], rcond=1e-8)
        if rank < regressors.shape[1]:
            raise ValueError("the motion of the tested axis does not tell the friction parameters apart")
        return (solution / scale)[:3]

    def test_quantity(self, batch: Batch) -> float:
        """Return the mean rise of the friction curve over the nominal speed range [N m]."""
        change = self.estimate_parameters(batch) - self.nominal
        return float(np.sum(np.asarray(self.weights) * self.mean_regressors * change))


DETECTOR = FrictionFit
