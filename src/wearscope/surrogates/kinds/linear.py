"""Surrogates that are linear in their coefficients: the full quadratic model, and sparse polynomial chaos.

The candidate terms of the chaos are products of Legendre polynomials up to a total degree. Least-angle
regression (Efron et al. 2004, Ann. Statist. 32(2)) orders them, and the corrected leave-one-out error decides
how many are used: Blatman and Sudret 2011, J. Comput. Phys. 230.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import eval_legendre

from wearscope.designs.bases import model_matrix, model_terms
from wearscope.designs.factors import CODED_HIGH
from wearscope.surrogates.kinds.base import model_fit

Array = NDArray[np.float64]
Basis = Callable[[ArrayLike], Array]
QUADRATIC = "quadratic"
POLYNOMIAL_CHAOS = "polynomial_chaos"
DEGREE = 3
FOLDS = 5
#: Terms are added until the error exceeds `_WORSE` times the least error and there are more than `_FEW`
#: terms.
_WORSE, _FEW = 2.0, 10


class LinearSurrogate:
    """Least-squares fit on a given basis, with the multivariate t distribution of its coefficients.

    Parameters
    ----------
    kind : str
    basis : callable
        Function from coded levels (M, n) to regressors (M, p).
    z, y : array (N, n), (N,)
        Training runs; N > p.
    parameters : dict
    """

    def __init__(self, kind: str, basis: Basis, z: Array, y: Array, parameters: dict[str, Any]) -> None:
        self.kind, self.basis, self.parameters = kind, basis, parameters
        phi = basis(z)
        q, r = np.linalg.qr(phi)
        self.theta = np.linalg.solve(r, q.T @ y)
        residual = y - phi @ self.theta
        self.dof = len(y) - phi.shape[1]
        self.noise = float(np.sqrt(residual @ residual / self.dof))
        self.root = np.linalg.inv(r) * self.noise  # covariance is root root'
        free = np.maximum(1.0 - np.sum(q * q, axis=1), 1e-9)
        self.left_out = y - residual / free
        self.left_out_deviation = self.noise / np.sqrt(free)

    def predict(self, z: ArrayLike) -> tuple[Array, Array]:
        """See `wearscope.surrogates.kinds.base.FittedSurrogate`."""
        phi = self.basis(z)
        return phi @ self.theta, np.linalg.norm(phi @ self.root, axis=1)

    def draw(self, z: ArrayLike, rng: np.random.Generator, draws: int) -> Array:
        """See `wearscope.surrogates.kinds.base.FittedSurrogate`."""
        stretch = np.sqrt(self.dof / rng.chisquare(self.dof, size=(draws, 1)))
        theta = self.theta + stretch * (rng.standard_normal((draws, len(self.theta))) @ self.root.T)
        return theta @ self.basis(z).T


def fit_quadratic(z: Array, y: Array, names: Sequence[str]) -> LinearSurrogate | None:
    """Fit the full second-order model (3); None where the runs do not determine it."""
    terms = model_terms("full", names)
    phi = model_matrix(z, names, terms)
    if len(y) <= len(terms) or np.linalg.matrix_rank(phi) < len(terms):
        return None
    return LinearSurrogate(QUADRATIC, lambda at: model_matrix(at, names, terms), z, y, {})


def legendre_basis(degrees: ArrayLike) -> Basis:
    """Return the basis of products of Legendre polynomials in z / 2 with degrees (p, n)."""
    powers = np.asarray(degrees, dtype=int)

    def evaluate(z: ArrayLike) -> Array:
        scaled = np.atleast_2d(np.asarray(z, dtype=float)) / CODED_HIGH
        one = eval_legendre(np.arange(powers.max() + 1)[:, None, None], scaled[None])  # (degree, M, n)
        columns = np.arange(scaled.shape[1])
        return np.stack([one[row, :, columns].prod(axis=0) for row in powers], axis=1)

    return evaluate


def _take_terms(phi: Array, y: Array) -> Iterator[list[int]]:
    """Yield the columns of phi (N, p) chosen by least-angle regression, with one more at each step."""
    mean, taken = np.zeros(len(y)), [0]
    for _ in range(min(phi.shape[1], len(y) - 1)):
        yield taken
        active, left = phi[:, taken], np.setdiff1d(np.arange(phi.shape[1]), taken)
        correlation = phi.T @ (y - mean)
        largest, others = abs(correlation[taken[-1]]), correlation[left]
        signs = np.where(correlation[taken] < 0.0, -1.0, 1.0)
        towards = np.linalg.lstsq(active.T @ active, signs)[0]
        if not len(left) or not signs @ towards > 0.0:
            return
        length = 1.0 / np.sqrt(signs @ towards)
        along = phi[:, left].T @ active @ towards * length
        with np.errstate(divide="ignore", invalid="ignore"):  # by columns that depend on those chosen
            steps = np.r_[(largest - others) / (length - along), (largest + others) / (length + along)]
        mean = mean + steps[steps > 0.0].min(initial=largest / length) * length * active @ towards
        taken = [*taken, int(left[np.argmax(np.abs(phi[:, left].T @ (y - mean)))])]


def _corrected_error(phi: Array, y: Array) -> float:
    """Return the mean square leave-one-out error, corrected for the number of regressors.

    It is infinite where the regressors are linearly dependent.
    """
    q, r = np.linalg.qr(phi)
    if np.linalg.matrix_rank(r) < len(r):
        return np.inf
    left_out = (y - q @ (q.T @ y)) / np.maximum(1.0 - np.sum(q * q, axis=1), 1e-9)
    return float(np.mean(left_out**2) * (1.0 + np.sum(np.linalg.inv(r) ** 2)) / (1.0 - len(r) / len(y)))


def choose_terms(z: Array, y: Array, degree: int = DEGREE) -> list[list[int]]:
    """Choose the Legendre products with the least corrected error; return their degrees (p, n)."""
    n = z.shape[1]
    several = [list(combinations_with_replacement(range(n), total)) for total in range(degree + 1)]
    degrees = np.array([[which.count(k) for k in range(n)] for same in several for which in same])
    phi = legendre_basis(degrees)(z) * np.sqrt(np.prod(2 * degrees + 1, axis=1))  # orthonormal
    best, least = [0], np.inf
    for taken in _take_terms(phi, y):
        error = _corrected_error(phi[:, taken], y)
        if error < least:
            best, least = taken, error
        elif error > _WORSE * least and len(taken) > _FEW:
            break
    return degrees[sorted(best)].tolist()


def fit_polynomial_chaos(z: Array, y: Array, to_beat: float = -np.inf) -> LinearSurrogate | None:
    """Fit sparse polynomial chaos; None where the runs are too few to choose and fit terms.

    Its cross-validated predictions come from five folds, each of which chooses its own terms, so that the
    error of the choice is included. Leave-one-out predictions with the terms chosen on all runs are
    optimistic. Where even their fit does not exceed `to_beat` [%], they are kept and the folds are not
    fitted, to save time.
    """
    n = z.shape[1]
    if len(y) < 4 * (n + 1) or np.ptp(y) == 0:
        return None
    fitted = rebuild_polynomial_chaos(z, y, {"degrees": choose_terms(z, y)})
    if fitted is None or model_fit(y, fitted.left_out) <= to_beat:
        return fitted
    fold = np.arange(len(y)) % FOLDS
    for k in range(FOLDS):
        seen = fold != k
        part = rebuild_polynomial_chaos(z[seen], y[seen], {"degrees": choose_terms(z[seen], y[seen])})
        if part is None:
            return None
        mean, deviation = part.predict(z[~seen])
        fitted.left_out[~seen] = mean
        fitted.left_out_deviation[~seen] = np.hypot(deviation, part.noise)
    return fitted


def rebuild_polynomial_chaos(z: Array, y: Array, parameters: dict[str, Any]) -> LinearSurrogate | None:
    """Fit polynomial chaos with given terms; None where the runs do not determine the coefficients."""
    basis = legendre_basis(parameters["degrees"])
    phi = basis(z)
    if len(y) <= phi.shape[1] or np.linalg.matrix_rank(phi) < phi.shape[1]:
        return None
    return LinearSurrogate(POLYNOMIAL_CHAOS, basis, z, y, parameters)
