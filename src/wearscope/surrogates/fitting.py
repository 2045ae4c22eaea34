"""Quadratic surrogates: least-squares regression (5) of the test quantity on coded factors, for every cell.

Each surrogate has the covariance of its coefficients, and coefficients normalised by that of the fault (8).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import special

from wearscope.designs.bases import MODELS, linear_names, model_matrix, model_terms, term_exponents
from wearscope.designs.factors import FAULT
from wearscope.errors import InputError

Array = NDArray[np.float64]


def hold_levels(names: Sequence[str], levels: Mapping[str, float], varied: Mapping[str, Array]) -> Array:
    """Return coded points (M, n), one column for each name: `varied` factors (M,), others at `levels`."""
    columns = (varied[name] if name in varied else levels[name] for name in names)
    return np.column_stack(np.broadcast_arrays(*columns)).astype(float)


@dataclass(frozen=True)
class Surrogate:
    """Quadratic surrogate (1) with its uncertainty, y = phi(z)' theta + eps.

    Parameters
    ----------
    terms : tuple of str, (p,)
        See `wearscope.designs.bases.model_terms`.
    theta : array (p,)
        Coefficients in coded units.
    covariance : array (p, p)
        Covariance of `theta`; NaN where unknown.
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
        """Return the coefficient of a term; 0 where the model does not have the term."""
        return float(self.theta[self.terms.index(term)]) if term in self.terms else 0.0

    @cached_property
    def quadratic(self) -> tuple[float, Array, Array]:
        """Constant c, gradient b (n,) and symmetric matrix Q (n, n) of y = c + b'z + z'Qz."""
        c, b, q = expand_coefficients(self.theta, self.terms, self.names)
        return float(c), b, q

    def predict(self, z: ArrayLike) -> Array:
        """Return the values at coded levels.

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
        """Return the standard error (N,) of the mean response at coded levels (N, n)."""
        phi = model_matrix(z, self.names, self.terms)
        return np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", phi, self.covariance, phi), 0.0))

    def prediction_interval(self, z: ArrayLike, level: float = 0.95) -> tuple[Array, Array]:
        """Return the interval that contains one new value with probability `level`, if the model is correct.

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
        """Draw coefficient vectors (draws, p) from the uncertainty of the estimate.

        Their distribution is the multivariate t with the estimate, its covariance and the residual degrees of
        freedom. The draws are NaN without degrees of freedom.
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
        """Return c, g (n-1,) and A (n-1, n-1) of y = c + g'w + w'Aw in the nuisances w at a fault level."""
        c, g, a = condition_on_fault(self.theta, self.terms, f)
        return float(c), g, a

    def along(self, factor: str, levels: dict[str, float]) -> Array:
        """Return a, b, c (3,) of y = a + b w + c w^2 along one factor, with the other factors fixed.

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
    """Return the quadratic form y = c + b'z + z'Qz of coefficient vectors.

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
        Symmetric.
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
    """Return the quadratic form y = c + g'w + w'Aw in the nuisances w at a fault level.

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


#: Columns that name a cell.
CELL = ["robot", "cycle", "axis", "fda"]
IDENTIFICATION = "identification"
VALIDATION = "validation"
_CONSTANT = 1e-12


def factor_columns(table: pd.DataFrame) -> list[str]:
    """Return the coded factor columns of a table of test quantities.

    They are the numeric columns other than the keys, ``set``, ``point``, ``y``, ``status`` and natural
    levels.

    Raises
    ------
    InputError
        Where a column that every study needs is missing.
    """
    missing = [name for name in (*CELL, "set", "point", FAULT, "y") if name not in table.columns]
    if missing:
        raise InputError(f"test quantities: there is no column '{missing[0]}'; make the table again.")
    known = {*CELL, "set", "point", "y", "status"}
    return [
        name
        for name in table.columns
        if name not in known
        and not name.endswith("_natural")
        and pd.api.types.is_numeric_dtype(table[name])
        and not pd.api.types.is_bool_dtype(table[name])
    ]


def cells_of(table: pd.DataFrame, extra: Sequence[str] = ()) -> Iterator[tuple[tuple, pd.DataFrame]]:
    """Yield key (robot, cycle, axis, fda, ...) and rows of each cell, in sorted order."""
    yield from table.groupby([*CELL, *extra], sort=True, observed=True)


def cell_name(key: Sequence[object]) -> str:
    """Return the name ``robot/cycle/axis/fda`` of a cell, for messages and seeds."""
    return "/".join(str(part) for part in key)


def fit_surrogate(z: ArrayLike, y: ArrayLike, names: Sequence[str], model: str) -> Surrogate:
    """Fit a surrogate to coded levels by least squares (5), with statsmodels.

    Parameters
    ----------
    z : array (N, n)
        Coded levels.
    y : array (N,)
        Finite test quantities.
    names : sequence of str, (n,)
    model : {"main", "full", "simplified"}

    Returns
    -------
    Surrogate
        Where every y is the same, the constant term is exactly that value, all other coefficients are 0, and
        the status is ``constant``.

    Raises
    ------
    InputError
        Where the points do not determine the coefficients.
    """
    y = np.asarray(y, dtype=float)
    terms = model_terms(model, names)
    phi = model_matrix(z, names, terms)
    rank = int(np.linalg.matrix_rank(phi))
    if rank < len(terms):
        raise InputError(
            f"model '{model}': {len(y)} points give rank {rank} for {len(terms)} terms; add points or choose "
            "a smaller model."
        )
    dof = len(y) - len(terms)
    if np.ptp(y) <= _CONSTANT * np.abs(y).max():
        theta = np.zeros(len(terms))
        theta[0] = y[0]
        return Surrogate(terms, theta, np.zeros((len(terms), len(terms))), 0.0, dof, "constant")
    from statsmodels.regression.linear_model import OLS  # here, because importing it takes a second

    result = OLS(y, phi).fit()
    if dof > 0:
        sigma = float(np.sqrt(result.ssr / dof))
        covariance = np.asarray(result.normalized_cov_params) * sigma**2
    else:
        sigma, covariance = np.nan, np.full((len(terms), len(terms)), np.nan)
    return Surrogate(terms, np.asarray(result.params, dtype=float), covariance, sigma, dof)


def normalise_coefficients(theta: ArrayLike, terms: Sequence[str]) -> np.ndarray:
    """Return coefficients relative to the direct effect of the fault, eq. (8); NaN where that effect is 0."""
    theta = np.asarray(theta, dtype=float)
    direct = theta[list(terms).index(FAULT)]
    if direct == 0 or not np.isfinite(direct):
        return np.full(theta.shape, np.nan)
    return theta / direct


def usable_points(rows: pd.DataFrame, key: Sequence[object], max_failed_share: float) -> pd.DataFrame:
    """Return the rows of a cell with a finite test quantity.

    Raises
    ------
    InputError
        Where more than `max_failed_share` of the rows are NaN or infinite.
    """
    good = np.isfinite(rows["y"].to_numpy(dtype=float))
    failed = int((~good).sum())
    if failed > max_failed_share * len(rows):
        points = ", ".join(str(point) for point in rows.loc[~good, "point"].head(5))
        raise InputError(
            f"cell {cell_name(key)}: {failed} of {len(rows)} test quantities failed (points {points}"
            f"{', ...' if failed > 5 else ''}), more than the allowed share {max_failed_share:g}; correct "
            "the detector or raise max_failed_share."
        )
    return rows[good]


def fit_surrogates(
    test_quantities: pd.DataFrame, models: Sequence[str] = MODELS, max_failed_share: float = 0.05
) -> pd.DataFrame:
    """Fit the quadratic surrogates of every cell.

    Parameters
    ----------
    test_quantities : DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``set``, ``point``, the coded factors, ``y``. The factor
        ``f`` is the wear of the cell's own axis. Only the set ``identification`` is used.
    models : sequence of str
    max_failed_share : float
        Largest share of NaN test quantities in a cell; up to it they are left out and counted.

    Returns
    -------
    DataFrame
        The keys, ``model``, ``term``, ``theta``, ``theta_normalised`` (8), ``stderr``; then ``covariance``
        (the term's row of the covariance matrix, in term order), ``sigma``, ``dof``, ``n_points``,
        ``n_failed``, ``status``. The rows of a surrogate are in term order.

    Raises
    ------
    InputError
        Where columns or identification rows are missing, too many points failed, or the points do not
        determine a model.
    """
    names = factor_columns(test_quantities)
    rows = test_quantities[test_quantities["set"] == IDENTIFICATION]
    if rows.empty:
        raise InputError(
            "test quantities: no row has the set 'identification'; run the identification points."
        )
    parts = []
    for key, cell in cells_of(rows):
        cell = cell.sort_values("point")
        good = usable_points(cell, key, max_failed_share)
        for model in models:
            try:
                surrogate = fit_surrogate(good[names].to_numpy(), good["y"].to_numpy(), names, model)
            except InputError as error:
                raise InputError(f"cell {cell_name(key)}, {error}") from error
            part = surrogate_rows(surrogate)
            for position, (name, value) in enumerate(zip([*CELL, "model"], [*key, model], strict=True)):
                part.insert(position, name, value)
            counts = {"n_points": len(good), "n_failed": len(cell) - len(good)}
            parts.append(part.assign(**counts, status=surrogate.status))
    return pd.concat(parts, ignore_index=True)


def surrogate_rows(surrogate: Surrogate) -> pd.DataFrame:
    """Return the rows of a surrogate, one for each term, without the keys."""
    return pd.DataFrame(
        {
            "term": list(surrogate.terms),
            "theta": surrogate.theta,
            "theta_normalised": normalise_coefficients(surrogate.theta, surrogate.terms),
            "stderr": np.sqrt(np.diag(surrogate.covariance)),
            "covariance": list(surrogate.covariance),
            "sigma": surrogate.sigma,
            "dof": surrogate.dof,
        }
    )


def read_surrogate(rows: pd.DataFrame) -> Surrogate:
    """Read a surrogate from the rows of one cell and model, in the order of `fit_surrogates`.

    Raises
    ------
    InputError
        Where the rows are not one complete surrogate.
    """
    terms = tuple(rows["term"])
    if len(set(terms)) != len(terms) or FAULT not in terms:
        raise InputError("surrogates: the rows are not one surrogate's terms; select one cell and one model.")
    if "covariance" in rows:
        covariance = np.stack([np.asarray(row, dtype=float) for row in rows["covariance"]])
    else:
        covariance = np.full((len(terms), len(terms)), np.nan)
    first = rows.iloc[0]
    return Surrogate(
        terms,
        rows["theta"].to_numpy(dtype=float),
        covariance,
        float(first.get("sigma", np.nan)),
        int(first.get("dof", 0)),
        str(first.get("status", "ok")),
    )


def surrogates_of(surrogates: pd.DataFrame, model: str | None = None) -> Iterator[tuple[tuple, Surrogate]]:
    """Yield key (robot, cycle, axis, fda, model) and surrogate of each cell and model, in sorted order.

    Raises
    ------
    InputError
        Where the table has no surrogate of that model.
    """
    rows = surrogates if model is None else surrogates[surrogates["model"] == model]
    if rows.empty:
        known = ", ".join(sorted(set(surrogates["model"])))
        raise InputError(f"surrogates: the table has no model '{model}'; it has {known}.")
    for key, group in cells_of(rows, ["model"]):
        yield key, read_surrogate(group)
