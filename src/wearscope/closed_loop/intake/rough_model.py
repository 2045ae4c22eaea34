"""Rough model of one joint's torque: rigid body, inertia, Coulomb and viscous friction, and an offset.

It is one least-squares fit per joint of [rigid body, a, sign, v, 1], and names no effect. It predicts a
torque that was clipped or lost, and shows up to which frequency the torque follows the motion, how wide the
friction's reversal is, and whether the columns hold what the data set says.
"""

from dataclasses import dataclass

import numpy as np
from scipy import optimize, sparse

from wearscope.closed_loop.intake.filtering import Band, rows, thinning

#: Only the middle of a torque's range is fitted, if it holds at least this share of the samples. Where
#: friction makes nearly all of a torque, the middle holds only reversals and rest, so all of it is fitted.
_MIDDLE = 0.5
#: Prior standard deviation of the rigid body's factor about 1; number of independent samples as which a run's
#: rows are weighed against this prior.
_FACTOR, _SAMPLES = 0.5, 30
#: Ridge on the coefficients of columns of unit length. Two columns may be collinear, as inertia and a rigid
#: body about one axis are; without a ridge, rounding decides where a bounded fit ends.
_HELD = 1e-7


def rough_columns(known: np.ndarray, a: np.ndarray, sign: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Regressors (N, 5) of one joint from its rigid-body torque, acceleration, direction and speed (N,)."""
    return np.column_stack([known, a, sign, v, np.ones(len(known))])


def fit_rough(columns: list[np.ndarray], torques: list[np.ndarray]) -> np.ndarray:
    """Coefficients (P,) by least squares over runs of columns (N, P) and torques (N,)."""
    return np.linalg.lstsq(np.vstack(columns), np.concatenate(torques), rcond=None)[0]


def fit_bounded(
    x: np.ndarray, y: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[float, np.ndarray]:
    """Least squares within bounds.

    Parameters
    ----------
    x : ndarray (N, P)
    y : ndarray (N,)
    lower, upper : ndarray (P,)

    Returns
    -------
    float
        Sum of squared residuals.
    ndarray (P,)
        Coefficients.
    """
    scale = np.maximum(np.linalg.norm(x, axis=0), 1e-12)
    held = _HELD * np.eye(x.shape[1], x.shape[1] + 1)
    r = np.asarray(np.linalg.qr(np.vstack([np.column_stack([x / scale, y]), held]), mode="r"))
    # The interior-reflective method may never end where the torque is far smaller than the columns.
    with np.errstate(invalid="ignore"):
        found = optimize.lsq_linear(r[:-1, :-1], r[:-1, -1], (lower * scale, upper * scale), method="bvls").x
    left = float(np.sum((r[:-1, :-1] @ found - r[:-1, -1]) ** 2) + r[-1, -1] ** 2)
    return left, found / scale


@dataclass(frozen=True)
class RoughRun:
    """Signals of one run for the rough model; arrays are (N, n).

    Attributes
    ----------
    use : str
    t : ndarray (N,)
    known, a, sign, v, tau : ndarray
    faulty : ndarray of bool
        Samples that are no measurements.
    slow : ndarray of bool
        Samples at which the direction of motion is not known.
    """

    use: str
    t: np.ndarray
    known: np.ndarray
    a: np.ndarray
    sign: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    faulty: np.ndarray
    slow: np.ndarray

    def columns(self, j: int) -> np.ndarray:
        """Regressors (N, 5) of joint j."""
        return rough_columns(self.known[:, j], self.a[:, j], self.sign[:, j], self.v[:, j])


def _is_inner(tau: np.ndarray) -> np.ndarray:
    """Samples (N,) in the middle 80 % of a torque's range, where it cannot be clipped."""
    low, high = tau.min(), tau.max()
    return (tau > low + 0.1 * (high - low)) & (tau < high - 0.1 * (high - low))


def predict_rough(runs: list[RoughRun], inner: bool) -> list[np.ndarray]:
    """Torque (N, n) of every run by the rough model of each joint, fitted on the train runs.

    Parameters
    ----------
    runs : list of RoughRun
    inner : bool
        Fit without faulty samples and rests, and only on the middle 80 % of each torque's range if that holds
        at least half of its samples.
    """
    predicted = [np.zeros_like(run.tau) for run in runs]
    train = [run for run in runs if run.use == "train"]
    for j in range(runs[0].tau.shape[1]):
        picked = [np.ones(len(run.t), dtype=bool) for run in train]
        if inner:
            picked = [~run.faulty[:, j] for run in train]
            moving = [good & ~run.slow[:, j] for good, run in zip(picked, train, strict=True)]
            if any(map(np.any, moving)):
                picked = moving
            middle = [good & _is_inner(run.tau[:, j]) for good, run in zip(picked, train, strict=True)]
            if sum(map(np.sum, middle)) >= _MIDDLE * sum(map(np.sum, picked)):
                picked = middle
        theta = fit_rough(
            [run.columns(j)[at] for at, run in zip(picked, train, strict=True)],
            [run.tau[at, j] for at, run in zip(picked, train, strict=True)],
        )
        for out, run in zip(predicted, runs, strict=True):
            out[:, j] = run.columns(j) @ theta
    return predicted


@dataclass(frozen=True)
class RestBridge:
    """Replacement of a joint's torque at rest by what the rough model says from its torque in motion.

    Static friction may have any value, which no regressor follows, and the common filter would carry it into
    the motion before and after. The replacement is linear and the same for the measured torque and each
    regressor, so that two regressors that are alike in motion remain alike.

    Attributes
    ----------
    rest : ndarray (N,) of bool
    columns : ndarray (R, 5)
        The rough model's regressors at rest.
    fit : ndarray (5, N - R)
        Coefficients of the rough model from a torque in motion.
    carried : sparse array (M, R)
        Weights with which the common filter carries samples at rest into rows in motion.
    """

    rest: np.ndarray
    columns: np.ndarray
    fit: np.ndarray
    carried: sparse.csr_matrix

    def predict(self, x: np.ndarray) -> np.ndarray:
        """Torques (R, K) at rest from those of the whole run, (N, K)."""
        return self.columns @ (self.fit @ x[~self.rest])

    def change(self, x: np.ndarray) -> np.ndarray:
        """What the replacement changes in torques (N, K) of the joint after the common filter, (M, K)."""
        return self.carried @ (self.predict(x) - x[self.rest])


def bridge_rest(
    left: np.ndarray, known: np.ndarray, a: np.ndarray, v: np.ndarray, rest: np.ndarray, band: Band
) -> dict[int, RestBridge]:
    """Bridges of the joints that both move and rest in a run.

    A joint's own motion may tell little of its rigid-body factor, as about an upright axis; a prior then
    keeps the factor near 1.

    Parameters
    ----------
    left : ndarray (N, n)
        Measured torque without that of the rigid body.
    known, a, v : ndarray (N, n)
        Torque of the rigid body, acceleration and speed.
    rest : ndarray (N, n) of bool
    band : Band
    """
    through = thinning(len(rest), band)
    in_motion = ~rest[rows(band, len(rest))]
    sign = np.where(rest, 0.0, np.sign(v))
    bridges = {}
    for j in map(int, np.flatnonzero(rest.any(axis=0) & ~rest.all(axis=0))):
        moves = ~rest[:, j]
        x = rough_columns(known[:, j], a[:, j], sign[:, j], v[:, j])
        error = left[moves, j] - x[moves] @ fit_rough([x[moves]], [left[moves, j]])
        held = np.zeros((1, x.shape[1]))
        held[0, 0] = np.sqrt(float(error @ error) / _SAMPLES) / _FACTOR
        # The bridge is not shifted to meet its neighbours: they hold friction, and the bridge
        # holds none.
        stacked = np.vstack([x[moves], held])
        fit = np.linalg.pinv(stacked, rcond=len(stacked) * np.finfo(float).eps)[:, :-1]
        carried = sparse.diags(in_motion[:, j].astype(float)) @ through[:, rest[:, j]]
        carried.eliminate_zeros()
        bridges[j] = RestBridge(rest[:, j], x[~moves], fit, carried)
    return bridges
