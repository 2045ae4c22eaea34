"""Least squares (5), normalised coefficients (8), for every cell."""

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from wearscope.designs.bases import MODELS, model_matrix, model_terms
from wearscope.designs.factors import FAULT
from wearscope.errors import InputError
from wearscope.surrogates.surrogate import Surrogate

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
