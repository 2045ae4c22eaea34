"""Marginal likelihood of the Gaussian process's hyperparameters and its gradient, from few matrix products.

scikit-learn takes the derivative of its kernel by each hyperparameter as a matrix and multiplies each with
the same one; here the sums are taken at once, from squared distances that no hyperparameter changes, which
costs a fifth. Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, eqs. (5.8), (5.9).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cholesky
from scipy.linalg.lapack import dpotri

Array = NDArray[np.float64]
#: Added to the diagonal, as scikit-learn does, so that rounding leaves the matrix positive.
DIAGONAL = 1e-10


class Hyperparameters(NamedTuple):
    """Hyperparameters from their logarithms, in scikit-learn's order.

    Attributes
    ----------
    variance : float
        Of the Matern part.
    lengths : array (n,)
    quadratic, offset : float
        Factor and offset of the quadratic part, ``quadratic (offset^2 + x'z)^2``.
    noise : float
        Variance of one run.
    """

    variance: float
    lengths: Array
    quadratic: float
    offset: float
    noise: float

    @classmethod
    def from_logarithms(cls, theta: Array) -> "Hyperparameters":
        """From the vector (n + 4,) that is searched."""
        value = np.exp(theta)
        return cls(float(value[0]), value[1:-3], float(value[-3]), float(value[-2]), float(value[-1]))


class Likelihood:
    """Negative logarithm of the marginal likelihood of a Matern 5/2 and a quadratic part with noise.

    Parameters
    ----------
    seen : array (N, n)
        Training points as the process sees them.
    target : array (N,)
        Standardised y.
    """

    def __init__(self, seen: Array, target: Array) -> None:
        self.target = target
        n = seen.shape[1]
        self.squares = ((seen[:, None, :] - seen[None, :, :]) ** 2).reshape(-1, n)
        self.products = seen @ seen.T

    def __call__(self, theta: Array) -> tuple[float, Array]:
        """Value and gradient (n + 4,) at the logarithms `theta` (n + 4,); infinity where it is undefined."""
        given = Hyperparameters.from_logarithms(theta)
        count = len(self.target)
        inner = 5.0 * given.lengths**-2
        ratio = np.sqrt(self.squares @ inner).reshape(count, count)
        decay = given.variance * np.exp(-ratio)
        matern = (1.0 + ratio * (1.0 + ratio / 3.0)) * decay
        square = given.offset**2 + self.products
        quadratic = given.quadratic * square**2
        covariance = matern + quadratic
        covariance.flat[:: count + 1] += given.noise + DIAGONAL
        try:
            root = cholesky(covariance, lower=True, check_finite=False, overwrite_a=True)
        except LinAlgError:
            return np.inf, np.zeros_like(theta)
        half, _ = dpotri(root, lower=True)
        inverse = np.tril(half) + np.tril(half, -1).T
        weights = inverse @ self.target
        value = 0.5 * self.target @ weights + np.log(np.diag(root)).sum() + 0.5 * count * np.log(2.0 * np.pi)
        # The derivative by a hyperparameter is the sum of this matrix times that of the covariance.
        by_covariance = 0.5 * (inverse - np.outer(weights, weights))
        by_distance = (by_covariance * (1.0 + ratio) * decay).ravel()
        gradient = np.concatenate(
            [
                [np.vdot(by_covariance, matern)],
                (by_distance @ self.squares) * inner / 3.0,
                [np.vdot(by_covariance, quadratic)],
                [4.0 * given.quadratic * given.offset**2 * np.vdot(by_covariance, square)],
                [given.noise * np.trace(by_covariance)],
            ]
        )
        return float(value), gradient
