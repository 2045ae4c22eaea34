"""What every fitted surrogate offers, whatever its kind."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray


def model_fit(y: ArrayLike, predicted: ArrayLike) -> float:
    """Model fit (6) [%]: 100 (1 - |y - yhat| / |y - mean y|); NaN where y does not vary."""
    y, predicted = np.asarray(y, dtype=float), np.asarray(predicted, dtype=float)
    if y.size == 0 or np.ptp(y) <= 1e-12 * np.abs(y).max():
        return float("nan")
    return float(100.0 * (1.0 - np.linalg.norm(y - predicted) / np.linalg.norm(y - y.mean())))


def pure_error(z: ArrayLike, y: ArrayLike) -> tuple[float, int]:
    """Sum of squares and degrees of freedom of replicated points."""
    z, y = np.round(np.asarray(z, dtype=float), 9), np.asarray(y, dtype=float)
    _, group = np.unique(z, axis=0, return_inverse=True)
    group = group.ravel()
    count = np.bincount(group)
    means = np.bincount(group, weights=y) / count
    return float(np.sum((y - means[group]) ** 2)), int(np.sum(count - 1))


Array = NDArray[np.float64]


class FittedSurrogate(Protocol):
    """A surrogate fitted to the runs of one cell.

    Attributes
    ----------
    kind : str
        Its name in tables.
    noise : float
        Standard deviation of one run about the surrogate, in units of y.
    left_out : array (N,)
        Prediction of each training value by a fit that had not seen it.
    left_out_deviation : array (N,)
        Standard deviation of the error of `left_out`, noise included, as the surrogate itself states it.
    parameters : dict
        What, together with the training runs, makes the same surrogate again; JSON-able.
    """

    kind: str
    noise: float
    left_out: Array
    left_out_deviation: Array
    parameters: dict[str, Any]

    def predict(self, z: ArrayLike) -> tuple[Array, Array]:
        """Mean response at coded levels (M, n) and the standard deviation of that mean, (M,) each."""

    def draw(self, z: ArrayLike, rng: np.random.Generator, draws: int) -> Array:
        """Response functions that the runs allow, at coded levels (M, n), shape (draws, M); no noise."""
