"""Interface of a fitted surrogate of any kind, the fit (6) and the noise from replicates."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray


def model_fit(y: ArrayLike, predicted: ArrayLike) -> float:
    """Return the fit (6) [%], 100 (1 - |y - predicted| / |y - mean y|); NaN where y is constant."""
    y, predicted = np.asarray(y, dtype=float), np.asarray(predicted, dtype=float)
    if y.size == 0 or np.ptp(y) <= 1e-12 * np.abs(y).max():
        return float("nan")
    return float(100.0 * (1.0 - np.linalg.norm(y - predicted) / np.linalg.norm(y - y.mean())))


def pure_error(z: ArrayLike, y: ArrayLike) -> tuple[float, int]:
    """Return sum of squares and degrees of freedom of the noise, from replicated points."""
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
        Name of the kind in tables.
    noise : float
        Standard deviation of one run about the mean response, in the unit of y.
    parameters : dict
        Parameters from which, with the training runs, the same surrogate can be built; JSON can hold them.
    """

    kind: str
    noise: float
    parameters: dict[str, Any]

    @property
    def left_out(self) -> Array:
        """Cross-validated prediction (N,) of each training value, by a fit that did not use it."""

    @property
    def left_out_deviation(self) -> Array:
        """Standard deviation (N,) of the error of `left_out`, with noise, as the surrogate estimates it."""

    def predict(self, z: ArrayLike) -> tuple[Array, Array]:
        """Return mean response (M,) and standard deviation (M,) of that mean at coded levels (M, n)."""

    def draw(self, z: ArrayLike, rng: np.random.Generator, draws: int) -> Array:
        """Draw response functions (draws, M) at coded levels (M, n) from the uncertainty, without noise."""
