"""Surrogates linear in their coefficients: the full quadratic model, and sparse polynomial chaos.

The terms of the chaos are chosen by OpenTURNS (least-angle regression, corrected leave-one-out error) among
the products of Legendre polynomials up to a total degree; Blatman and Sudret, Adaptive sparse polynomial
chaos expansion based on least angle regression, J. Comput. Phys. 230 (2011).
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import eval_legendre

from wearscope.designs.bases import model_matrix, model_terms
from wearscope.designs.factors import CODED_HIGH
from wearscope.surrogates.goodness import model_fit

Array = NDArray[np.float64]
Basis = Callable[[ArrayLike], Array]
QUADRATIC = "quadratic"
POLYNOMIAL_CHAOS = "polynomial_chaos"
DEGREE = 3
FOLDS = 5


class LinearSurrogate:
    """Least squares on a given basis, with the multivariate t distribution of its coefficients.

    Parameters
    ----------
    kind : str
    basis : callable
        Coded levels (M, n) to regressors (M, p).
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
    """Full second-order model (3) on all training runs; None where they do not determine it."""
    terms = model_terms("full", names)
    phi = model_matrix(z, names, terms)
    if len(y) <= len(terms) or np.linalg.matrix_rank(phi) < len(terms):
        return None
    return LinearSurrogate(QUADRATIC, lambda at: model_matrix(at, names, terms), z, y, {})


def legendre_basis(degrees: ArrayLike) -> Basis:
    """Products of Legendre polynomials in z / 2, of degrees (p, n)."""
    powers = np.asarray(degrees, dtype=int)

    def evaluate(z: ArrayLike) -> Array:
        scaled = np.atleast_2d(np.asarray(z, dtype=float)) / CODED_HIGH
        one = eval_legendre(np.arange(powers.max() + 1)[:, None, None], scaled[None])  # (degree, M, n)
        columns = np.arange(scaled.shape[1])
        return np.stack([one[row, :, columns].prod(axis=0) for row in powers], axis=1)

    return evaluate


def choose_terms(z: Array, y: Array, degree: int = DEGREE) -> list[list[int]]:
    """Degrees of the Legendre products that OpenTURNS keeps, the constant among them."""
    import openturns as ot  # here, because importing it takes two seconds

    ot.Log.Show(ot.Log.NONE)
    n = z.shape[1]
    enumeration = ot.LinearEnumerateFunction(n)
    basis = ot.OrthogonalProductPolynomialFactory([ot.LegendreFactory()] * n, enumeration)
    size = enumeration.getStrataCumulatedCardinal(degree)
    rule = ot.LeastSquaresMetaModelSelectionFactory(ot.LARS(), ot.CorrectedLeaveOneOut())
    uniform = ot.JointDistribution([ot.Uniform(-CODED_HIGH, CODED_HIGH)] * n)
    search = ot.FunctionalChaosAlgorithm(
        ot.Sample(z),
        ot.Sample(y[:, None]),
        uniform,
        ot.FixedStrategy(basis, size),
        ot.LeastSquaresStrategy(rule),
    )
    search.run()
    degrees = [[int(k) for k in enumeration(int(index))] for index in search.getResult().getIndices()]
    constant = [0] * n
    return [constant, *(one for one in degrees if one != constant)]


def fit_polynomial_chaos(z: Array, y: Array, to_beat: float = -np.inf) -> LinearSurrogate | None:
    """Sparse polynomial chaos; None with too few runs to choose and fit terms.

    Its left-out predictions are those of fits to four fifths of the runs that chose their terms anew, so that
    they pay for the choice too. Where without paying for it, each run left out in turn of the terms chosen on
    all, their fit is not above `to_beat` [%], they stay those, which flatter it.
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
    """Polynomial chaos of chosen terms; None where the runs do not determine their coefficients."""
    basis = legendre_basis(parameters["degrees"])
    phi = basis(z)
    if len(y) <= phi.shape[1] or np.linalg.matrix_rank(phi) < phi.shape[1]:
        return None
    return LinearSurrogate(POLYNOMIAL_CHAOS, basis, z, y, parameters)
