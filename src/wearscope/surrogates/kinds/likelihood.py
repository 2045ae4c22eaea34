"""Marginal likelihood of the Gaussian process's hyperparameters and its gradient, from few matrix products.

scikit-learn takes the derivative of its kernel by each hyperparameter as a matrix and multiplies each with
the same one; here the sums are taken at once, from squared distances that no hyperparameter changes, which
costs a fifth. Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, eqs. (5.8), (5.9).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsymv
from scipy.linalg.lapack import dpotrf, dpotri

Array = NDArray[np.float64]
#: Added to the diagonal, as scikit-learn does, so that rounding leaves the matrix positive.
DIAGONAL = 1e-10


class Hyperparameters(NamedTuple):
    """Hyperparameters of the process for standardised y, in the order in which their logarithms are kept.

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

    Symmetric matrices are held as their lower triangles, (M,) with M = N (N + 1) / 2, which is half the work.

    Parameters
    ----------
    seen : array (N, n)
        Training points as the process sees them.
    target : array (N,)
        Standardised y.
    """

    def __init__(self, seen: Array, target: Array) -> None:
        self.target = target
        count = len(target)
        column, row = np.triu_indices(count)  # column by column of the lower triangle, as LAPACK holds it
        self.squares = (seen[row] - seen[column]) ** 2
        self.products = (seen @ seen.T)[row, column]
        self._row, self._column = row, column
        #: Where the triangle lies in a matrix, and half of how often its elements count in a sum.
        self._place = column * count + row
        self._times = np.where(row == column, 0.5, 1.0)
        self._diagonal = np.flatnonzero(row == column)
        self._matrix = np.zeros(count * count)

    def __call__(self, theta: Array) -> tuple[float, Array]:
        """Value and gradient (n + 4,) at the logarithms `theta` (n + 4,); infinity where it is undefined."""
        given = Hyperparameters.from_logarithms(theta)
        count = len(self.target)
        inner = 5.0 * given.lengths**-2
        ratio = self.squares @ inner
        np.sqrt(ratio, out=ratio)
        decay = np.exp(-ratio)
        decay *= given.variance
        # Matern is (1 + ratio + ratio^2 / 3) decay; its derivative by a squared distance, (1 + ratio) decay.
        slope = (1.0 + ratio) * decay
        ratio *= ratio
        ratio *= decay
        ratio *= 1.0 / 3.0
        matern = np.add(ratio, slope, out=ratio)
        square = self.products + given.offset**2
        quadratic = square * square
        quadratic *= given.quadratic
        covariance = matern + quadratic
        covariance[self._diagonal] += given.noise + DIAGONAL
        self._matrix[self._place] = covariance
        root, failed = dpotrf(self._matrix.reshape(count, count).T, lower=True, clean=False, overwrite_a=True)
        if failed:
            return np.inf, np.zeros_like(theta)
        logarithm = float(np.log(np.diag(root)).sum())
        half, _ = dpotri(root, lower=True, overwrite_c=True)
        weights = dsymv(1.0, half, self.target, lower=True)
        value = 0.5 * self.target @ weights + logarithm + 0.5 * count * np.log(2.0 * np.pi)
        # The derivative by a hyperparameter is the sum of this matrix times that of the covariance.
        by_covariance = half.T.reshape(-1)[self._place]
        by_covariance -= weights[self._row] * weights[self._column]
        by_covariance *= self._times
        slope *= by_covariance
        gradient = np.concatenate(
            [
                [np.vdot(by_covariance, matern)],
                (slope @ self.squares) * inner / 3.0,
                [np.vdot(by_covariance, quadratic)],
                [4.0 * given.quadratic * given.offset**2 * np.vdot(by_covariance, square)],
                [given.noise * by_covariance[self._diagonal].sum()],
            ]
        )
        return float(value), gradient
