"""Gaussian process surrogate: a quadratic part, an anisotropic Matern 5/2 part, and noise.

Some test quantities change fast where one factor is nominal. For example, the residual of detector A nearly
vanishes at the temperature at which it learned. A stationary process would need many runs there. So a process
may transform ("bend") one factor. ``root`` replaces it by the signed cube root of its distance to nominal,
and adds a smooth step at nominal as a further input. ``steps`` keeps the factor and adds a narrow and a wide
step. Cross-validation chooses whether and how a factor is bent.

The marginal likelihood of the hyperparameters and its gradient need only a few matrix products. Unlike in
scikit-learn, the derivatives of the kernel are not formed as matrices: all sums use squared distances that do
not depend on the hyperparameters. This takes a fifth of the time. Rasmussen and Williams, Gaussian Processes
for Machine Learning, 2006, eqs. (5.8), (5.9).
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.linalg.blas import dsymv
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.spatial.distance import cdist

Array = NDArray[np.float64]

#: Added to the diagonal, as in scikit-learn, so that the matrix stays positive definite despite rounding.
DIAGONAL = 1e-10


class Hyperparameters(NamedTuple):
    """Hyperparameters of the process for standardised y; a vector holds their logarithms in this order.

    Attributes
    ----------
    variance : float
        Variance of the Matern part.
    lengths : array (n,)
        Length scales of the Matern part.
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
        """Return the hyperparameters from the vector (n + 4,) of their logarithms."""
        value = np.exp(theta)
        return cls(float(value[0]), value[1:-3], float(value[-3]), float(value[-2]), float(value[-1]))


class Likelihood:
    """Negative logarithm of the process's marginal likelihood, as a function of the hyperparameters.

    Symmetric matrices are stored as their lower triangles, (M,) with M = N (N + 1) / 2, which halves the
    work.

    Parameters
    ----------
    seen : array (N, n)
        Training points after a factor was bent.
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
        # Indices of the triangle's elements in the flat matrix. Off-diagonal elements occur twice in a sum
        # over the matrix; all weights are halved.
        self._place = column * count + row
        self._times = np.where(row == column, 0.5, 1.0)
        self._diagonal = np.flatnonzero(row == column)
        self._matrix = np.zeros(count * count)

    def __call__(self, theta: Array) -> tuple[float, Array]:
        """Return value and gradient (n + 4,) at the logarithms `theta`; infinity where it is undefined."""
        given = Hyperparameters.from_logarithms(theta)
        count = len(self.target)
        inner = 5.0 * given.lengths**-2
        ratio = self.squares @ inner
        np.sqrt(ratio, out=ratio)
        decay = np.exp(-ratio)
        decay *= given.variance
        # The Matern part is (1 + ratio + ratio^2 / 3) decay. Its derivative with respect to a squared
        # distance is proportional to (1 + ratio) decay.
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
        # The derivative with respect to a hyperparameter is the sum over the elementwise product of this
        # matrix and the derivative of the covariance.
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


GAUSSIAN_PROCESS = "gaussian_process"
BENT_GAUSSIAN_PROCESS = "bent_gaussian_process"
#: Coded widths of the narrow and of the wide step at nominal.
STEP, WIDE_STEP = 0.1, 0.4
SHAPES = ("root", "steps")
#: Length scales at which the search starts; there are two, as the likelihood may have several maxima.
FIRST_LENGTHS = (4.0, 1.5)
ITERATIONS = 60
#: The search ends where a step improves the logarithm of the likelihood by less than this share. With some
#: hundreds of runs that is about 0.001. It is negligible, as the logarithm changes by 2 over the confidence
#: interval of a hyperparameter.
ENOUGH = 1e-6
#: With at least this many runs for each hyperparameter, half of the runs suffice to compare the starts.
FEWEST_HALVED = 8
#: Number of covariances that are computed at once for the mean response: they fit into the processor's cache.
CELLS = 2**16
#: Added to the variance of standardised y where functions are drawn, so that it stays positive despite
#: rounding.
JITTER = 1e-8


class GaussianProcess:
    """Gaussian process at given hyperparameters.

    Parameters
    ----------
    z, y : array (N, n), (N,)
        Training runs.
    parameters : dict
        ``theta``, logarithms of the `Hyperparameters` for standardised y without the noise; ``log_noise``,
        logarithm of the noise's variance; ``log_lengths``, logarithms of the length scales by factor;
        ``bent``, the column of the bent factor or None; ``centre``, its nominal level; ``shape``, one of
        `SHAPES`.
    """

    def __init__(self, z: Array, y: Array, parameters: dict[str, Any]) -> None:
        bent = parameters["bent"]
        self.kind = GAUSSIAN_PROCESS if bent is None else BENT_GAUSSIAN_PROCESS
        self.parameters = parameters
        self.middle, self.scale = float(y.mean()), float(y.std())
        theta = np.array([*parameters["theta"], parameters["log_noise"]])
        self._given = Hyperparameters.from_logarithms(theta)
        self.noise = self.scale * float(np.sqrt(self._given.noise))
        self._seen = self._see(z)
        covariance = self._covary(self._seen, self._seen)
        covariance[np.diag_indices_from(covariance)] += self._given.noise
        self._root = cholesky(covariance, lower=True)
        self._target = (y - self.middle) / self.scale
        self._weights = cho_solve((self._root, True), self._target)

    @cached_property
    def _inverse(self) -> Array:
        """Inverse of the training runs' covariance (N, N); only cross-validation needs it."""
        return cho_solve((self._root, True), np.eye(len(self._target)))

    @cached_property
    def left_out(self) -> Array:
        """See `wearscope.surrogates.kinds.base.FittedSurrogate`."""
        return self.middle + self.scale * (
            self._target - self._inverse @ self._target / np.diag(self._inverse)
        )

    @cached_property
    def left_out_deviation(self) -> Array:
        """See `wearscope.surrogates.kinds.base.FittedSurrogate`."""
        return self.scale / np.sqrt(np.diag(self._inverse))

    def _see(self, z: ArrayLike) -> Array:
        """Return coded levels (M, n) as inputs of the process, with one factor bent where it has one."""
        return _see(z, self.parameters["bent"], self.parameters["centre"], self.parameters["shape"])

    def _covary(self, one: Array, other: Array) -> Array:
        """Return the prior covariances (M, K) between points (M, n) and points (K, n), without noise."""
        given = self._given
        ratio = np.sqrt(5.0) * cdist(one / given.lengths, other / given.lengths)
        matern = (1.0 + ratio + ratio**2 / 3.0) * np.exp(-ratio)
        return given.variance * matern + given.quadratic * (np.inner(one, other) + given.offset**2) ** 2

    def _condition(self, seen: Array) -> tuple[Array, Array]:
        """Return the mean (M,) at points, and a matrix R (N, M).

        R'R is the part of the prior covariance that the training runs remove.
        """
        across = self._covary(seen, self._seen)
        return across @ self._weights, solve_triangular(self._root, across.T, lower=True)

    def predict(self, z: ArrayLike) -> tuple[Array, Array]:
        """See `wearscope.surrogates.kinds.base.FittedSurrogate`."""
        seen, given = self._see(z), self._given
        mean, known = self._condition(seen)
        prior = given.variance + given.quadratic * (np.einsum("ij,ij->i", seen, seen) + given.offset**2) ** 2
        variance = np.maximum(prior - np.einsum("ij,ji->i", known.T, known), 0.0)
        return self.middle + self.scale * mean, self.scale * np.sqrt(variance)

    def predict_mean(self, z: ArrayLike) -> Array:
        """Return the mean response (M,) alone, much faster: the quadratic part is one form for all runs."""
        given, seen, trained, weights = self._given, self._see(z), self._seen, self._weights
        form = given.quadratic * (weights * trained.T) @ trained
        line = 2.0 * given.quadratic * given.offset**2 * (weights @ trained)
        level = given.quadratic * given.offset**4 * weights.sum()
        mean = np.einsum("ij,ij->i", seen @ form + line, seen) + level
        scaled, centres = (np.sqrt(5.0) * points / given.lengths for points in (seen, trained))
        squares, rows = (centres**2).sum(axis=1), max(1, CELLS // len(weights))
        for k in range(0, len(seen), rows):
            at = scaled[k : k + rows]
            square = squares - 2.0 * (at @ centres.T) + (at**2).sum(axis=1)[:, None]
            np.maximum(square, 0.0, out=square)
            ratio = np.sqrt(square)
            square *= 1.0 / 3.0
            square += ratio
            square += 1.0
            square *= np.exp(np.negative(ratio, out=ratio), out=ratio)
            mean[k : k + rows] += given.variance * (square @ weights)
        return self.middle + self.scale * mean

    def draw(self, z: ArrayLike, rng: np.random.Generator, draws: int) -> Array:
        """See `wearscope.surrogates.kinds.base.FittedSurrogate`."""
        seen = self._see(z)
        mean, known = self._condition(seen)
        covariance = self._covary(seen, seen) - known.T @ known
        root = np.linalg.cholesky(covariance + JITTER * np.eye(len(mean)))
        return self.middle + self.scale * (mean + rng.standard_normal((draws, len(mean))) @ root.T)


def fit_gaussian_process(
    z: Array,
    y: Array,
    noise: float = 0.0,
    bent: int | None = None,
    centre: float = 0.0,
    shape: str = SHAPES[0],
    plain: GaussianProcess | None = None,
) -> GaussianProcess | None:
    """Fit the Gaussian process with the largest marginal likelihood.

    Parameters
    ----------
    z, y : array (N, n), (N,)
        Training runs.
    noise : float
        Standard deviation of a run from replicates; 0 where unknown. The search for the noise starts at this
        value and does not go below half of it.
    bent : int, optional
        Column of the factor that is bent at `centre`.
    centre : float
        Coded nominal level of that factor.
    shape : {"root", "steps"}
        How the factor is bent.
    plain : GaussianProcess, optional
        Process of the same runs without a bent factor; the search starts at its hyperparameters.

    Returns
    -------
    GaussianProcess or None
        None with too few runs or where y is constant.
    """
    scale = float(y.std())
    if len(y) < z.shape[1] + 4 or scale == 0:
        return None
    seen = _see(z, bent, centre, shape)
    known = float(np.clip((noise / scale) ** 2, 1e-7, 0.5))
    columns = seen.shape[1]
    first = np.log([1.0, *[4.0] * columns, 0.1, 1.0, known if noise > 0 else 1e-3])
    bounds = np.log([(1e-3, 1e4), *[(0.1, 100.0)] * columns, (1e-6, 1e3), (0.1, 10.0), (0.25 * known, 1.0)])
    target = (y - y.mean()) / scale

    def search(rows: slice, first: Array) -> Any:
        return scipy.optimize.minimize(
            Likelihood(seen[rows], target[rows]), first, jac=True, bounds=bounds, method="L-BFGS-B",
            options={"maxiter": ITERATIONS, "ftol": ENOUGH},
        )  # fmt: skip

    starts = _first_hyperparameters(first, columns, plain)
    if len(starts) > 1:
        # Half of the runs are enough to find the start that leads to the higher maximum, and take a seventh
        # of the time.
        part = slice(None, None, 2 if len(y) >= FEWEST_HALVED * len(first) else 1)
        starts = [min((search(part, first) for first in starts), key=lambda one: one.fun).x]
    theta = search(slice(None), starts[0]).x
    parameters = {
        "theta": [float(one) for one in theta[:-1]],
        "log_noise": float(theta[-1]),
        "log_lengths": [float(one) for one in theta[1 : 1 + z.shape[1]]],
        "bent": bent,
        "centre": centre,
        "shape": shape,
    }
    return GaussianProcess(z, y, parameters)


def _first_hyperparameters(theta: Array, columns: int, plain: GaussianProcess | None) -> list[Array]:
    """Return the logarithms (columns + 4,) at which the search starts.

    They are those of the process without a bent factor where it is given, else `theta` with two length
    scales.
    """
    if plain is None:
        starts = [theta.copy() for _ in FIRST_LENGTHS]
        for start, length in zip(starts, FIRST_LENGTHS, strict=True):
            start[1 : 1 + columns] = np.log(length)
        return starts
    found = np.array([*plain.parameters["theta"], plain.parameters["log_noise"]])
    # The inputs that bending adds have the last length scales.
    added = theta[len(found) - 3 : 1 + columns]
    return [np.concatenate([found[:-3], added, found[-3:]])]


def _see(z: ArrayLike, bent: int | None, centre: float, shape: str) -> Array:
    """Return the inputs of the process: the coded levels, or with one column bent and its steps added."""
    z = np.atleast_2d(np.asarray(z, dtype=float))
    if bent is None:
        return z
    away = z[:, bent] - centre
    step = 2.0 * np.tanh(away / STEP)
    if shape == "steps":
        return np.column_stack([z, step, 2.0 * np.tanh(away / WIDE_STEP)])
    seen = np.column_stack([z, step])
    seen[:, bent] = 2.0 * np.cbrt(away / 2.0)
    return seen
