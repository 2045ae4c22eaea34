"""What every fitted surrogate offers, whatever its kind."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
