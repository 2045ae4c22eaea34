"""Second-order regressions of the test quantity on coded factors, by least squares (5), for every cell.

Each has its own uncertainty, and normalised coefficients (8).
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


CELL = ["robot", "cycle", "axis", "fda"]
IDENTIFICATION = "identification"
VALIDATION = "validation"
_CONSTANT = 1e-12


def factor_columns(table: pd.DataFrame) -> list[str]:
    """Coded factor columns of a test-quantity table: all but the keys, ``set``, ``point``, ``y``, natural.

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
    """Cells of a table in sorted order: key tuple (robot, cycle, axis, fda, ...) and rows."""
    yield from table.groupby([*CELL, *extra], sort=True, observed=True)


def cell_name(key: Sequence[object]) -> str:
    """``robot/cycle/axis/fda`` for messages and seeds."""
    return "/".join(str(part) for part in key)


def fit_surrogate(z: ArrayLike, y: ArrayLike, names: Sequence[str], model: str) -> Surrogate:
    """Least-squares surrogate (5) on coded levels, by statsmodels.

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
        Where every y is the same, its coefficients are exactly that constant and zeros, with status
        ``constant``.

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
    """Coefficients relative to the direct effect of the fault, eq. (8); NaN where that effect is zero."""
    theta = np.asarray(theta, dtype=float)
    direct = theta[list(terms).index(FAULT)]
    if direct == 0 or not np.isfinite(direct):
        return np.full(theta.shape, np.nan)
    return theta / direct


def usable_points(rows: pd.DataFrame, key: Sequence[object], max_failed_share: float) -> pd.DataFrame:
    """Rows of a cell with a finite test quantity.

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
    """Surrogates of every cell.

    Parameters
    ----------
    test_quantities : DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``set``, ``point``, the coded factors as that axis sees them,
        ``y``; only the set ``identification`` is used.
    models : sequence of str
    max_failed_share : float
        Largest share of NaN test quantities in a cell; below it they are left out and counted.

    Returns
    -------
    DataFrame
        The keys, ``model``, ``term``, ``theta``, ``theta_normalised`` (8), ``stderr``; then ``covariance``
        (the term's row of the covariance matrix, in term order), ``sigma``, ``dof``, ``n_points``,
        ``n_failed``, ``status``. Rows of a surrogate stay in term order.

    Raises
    ------
    InputError
        Missing columns, no identification rows, too many failed points, an unestimable model.
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
    """One row a term of a surrogate, without its keys."""
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
    """Surrogate of one cell's and model's rows, in the order in which `fit_surrogates` wrote them.

    Raises
    ------
    InputError
        Where the rows are not one whole surrogate.
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
    """Each surrogate of a table with its key (robot, cycle, axis, fda, model), in sorted order.

    Raises
    ------
    InputError
        Where the table holds no surrogate of that model.
    """
    rows = surrogates if model is None else surrogates[surrogates["model"] == model]
    if rows.empty:
        known = ", ".join(sorted(set(surrogates["model"])))
        raise InputError(f"surrogates: the table has no model '{model}'; it has {known}.")
    for key, group in cells_of(rows, ["model"]):
        yield key, read_surrogate(group)
