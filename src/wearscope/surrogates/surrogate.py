"""A second-order regression of the test quantity on coded factors, with its own uncertainty."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from wearscope.designs.bases import linear_names, model_matrix, term_exponents
from wearscope.designs.factors import FAULT

Array = NDArray[np.float64]


def hold_levels(names: Sequence[str], levels: Mapping[str, float], varied: Mapping[str, Array]) -> Array:
    """Coded points (M, n), a column for each name: factors that vary, (M,), and all others at `levels`."""
    columns = (varied[name] if name in varied else levels[name] for name in names)
    return np.column_stack(np.broadcast_arrays(*columns)).astype(float)


@dataclass(frozen=True)
class Surrogate:
    """Surrogate model (1), y = phi(z)' theta + eps.

    Parameters
    ----------
    terms : tuple of str, (p,)
        See `wearscope.designs.bases.model_terms`.
    theta : array (p,)
        Coefficients in coded units.
    covariance : array (p, p)
        Covariance of `theta`; NaN where it is unknown.
    sigma : float
        Residual standard deviation; NaN without residual degrees of freedom.
    dof : int
        Residual degrees of freedom.
    status : str
        ``ok``, or ``constant`` where every identification value was the same.
    """

    terms: tuple[str, ...]
    theta: Array
    covariance: Array
    sigma: float
    dof: int
    status: str = "ok"

    @property
    def names(self) -> tuple[str, ...]:
        """Factor names, in column order."""
        return linear_names(self.terms)

    def coefficient(self, term: str) -> float:
        """Coefficient of a term; 0 where the model leaves it out."""
        return float(self.theta[self.terms.index(term)]) if term in self.terms else 0.0

    @cached_property
    def quadratic(self) -> tuple[float, Array, Array]:
        """Constant c, gradient b (n,) and symmetric matrix Q (n, n) of y = c + b'z + z'Qz."""
        c, b, q = expand_coefficients(self.theta, self.terms, self.names)
        return float(c), b, q

    def predict(self, z: ArrayLike) -> Array:
        """Values at coded levels.

        Parameters
        ----------
        z : array (N, n)
            Columns in the order of `names`.

        Returns
        -------
        array (N,)
        """
        z = np.atleast_2d(np.asarray(z, dtype=float))
        c, b, q = self.quadratic
        product = z @ q
        product += b
        product *= z
        return product.sum(axis=1) + c

    def standard_error(self, z: ArrayLike) -> Array:
        """Give the standard error of the mean prediction at coded levels (N, n), shape (N,)."""
        phi = model_matrix(z, self.names, self.terms)
        return np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", phi, self.covariance, phi), 0.0))

    def prediction_interval(self, z: ArrayLike, level: float = 0.95) -> tuple[Array, Array]:
        """Interval that holds one new value with probability `level`, if the model is right.

        Parameters
        ----------
        z : array (N, n)
        level : float

        Returns
        -------
        low, high : array (N,)
            NaN without residual degrees of freedom.
        """
        value = self.predict(z)
        if self.dof < 1 and self.status != "constant":
            return np.full_like(value, np.nan), np.full_like(value, np.nan)
        width = np.hypot(self.standard_error(z), self.sigma)
        half = width * special.stdtrit(max(self.dof, 1), 0.5 + level / 2)
        return value - half, value + half

    def draw_coefficients(self, rng: np.random.Generator, draws: int) -> Array:
        """Coefficient vectors that the data allow, shape (draws, p).

        From the multivariate t distribution of the estimate, its covariance and the residual degrees of
        freedom; NaN without any.
        """
        if self.dof < 1 or not np.all(np.isfinite(self.covariance)):
            return np.full((draws, len(self.theta)), np.nan)
        scale = float(np.diag(self.covariance).max())
        if scale == 0:
            return np.tile(self.theta, (draws, 1))
        root = np.linalg.cholesky(self.covariance / scale) * np.sqrt(scale)
        stretch = np.sqrt(self.dof / rng.chisquare(self.dof, size=(draws, 1)))
        return self.theta + stretch * (rng.standard_normal((draws, len(self.theta))) @ root.T)

    def at_fault(self, f: float) -> tuple[float, Array, Array]:
        """c, g (n-1,), A (n-1, n-1) of y = c + g'w + w'Aw at a coded fault level."""
        c, g, a = condition_on_fault(self.theta, self.terms, f)
        return float(c), g, a

    def along(self, factor: str, levels: dict[str, float]) -> Array:
        """Give a, b, c of y = a + b w + c w^2 in one factor, the others held, (3,).

        Parameters
        ----------
        factor : str
        levels : dict of str to float
            Coded levels of all other factors.
        """
        c, b, q = self.quadratic
        k = self.names.index(factor)
        z = np.array([0.0 if name == factor else levels[name] for name in self.names])
        return np.array([c + b @ z + z @ q @ z, b[k] + 2.0 * q[k] @ z, q[k, k]])


def expand_coefficients(
    theta: ArrayLike, terms: tuple[str, ...], names: tuple[str, ...]
) -> tuple[Array, Array, Array]:
    """Quadratic form of coefficient vectors.

    Parameters
    ----------
    theta : array (..., p)
    terms : tuple of str, (p,)
    names : tuple of str, (n,)

    Returns
    -------
    c : array (...,)
    b : array (..., n)
    q : array (..., n, n)
        Symmetric; y = c + b'z + z'Qz.
    """
    theta = np.asarray(theta, dtype=float)
    n = len(names)
    c = np.zeros(theta.shape[:-1])
    b = np.zeros((*theta.shape[:-1], n))
    q = np.zeros((*theta.shape[:-1], n, n))
    for row, powers in enumerate(term_exponents(terms, names)):
        value = theta[..., row]
        where = np.repeat(np.arange(n), powers)
        if where.size == 0:
            c += value
        elif where.size == 1:
            b[..., where[0]] += value
        else:
            q[..., where[0], where[1]] += value / 2
            q[..., where[1], where[0]] += value / 2
    return c, b, q


def condition_on_fault(theta: ArrayLike, terms: tuple[str, ...], f: float) -> tuple[Array, Array, Array]:
    """Quadratic form in the nuisances at a fault level.

    Parameters
    ----------
    theta : array (..., p)
    terms : tuple of str, (p,)
    f : float
        Coded fault level.

    Returns
    -------
    c : array (...,)
    g : array (..., n - 1)
    a : array (..., n - 1, n - 1)
        y = c + g'w + w'Aw.
    """
    names = linear_names(terms)
    c, b, q = expand_coefficients(theta, terms, names)
    k = names.index(FAULT)
    rest = [i for i in range(len(names)) if i != k]
    return (
        c + b[..., k] * f + q[..., k, k] * f * f,
        b[..., rest] + 2.0 * f * q[..., k, rest],
        q[..., rest, :][..., :, rest],
    )
