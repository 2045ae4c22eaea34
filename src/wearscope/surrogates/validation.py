"""Validation of quadratic surrogates: fit (6) on validation runs, and diagnostics of the regression."""

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import special

from wearscope.designs.bases import model_matrix
from wearscope.designs.factors import FAULT
from wearscope.errors import InputError
from wearscope.surrogates.fitting import (
    CELL,
    IDENTIFICATION,
    VALIDATION,
    Surrogate,
    cell_name,
    cells_of,
    factor_columns,
    read_surrogate,
    usable_points,
)
from wearscope.surrogates.kinds.base import model_fit, pure_error


def leverage(phi: ArrayLike) -> np.ndarray:
    """Return the diagonal (N,) of the hat matrix Phi (Phi'Phi)^-1 Phi', by QR."""
    q, _ = np.linalg.qr(np.asarray(phi, dtype=float))
    return np.sum(q * q, axis=1)


def press(phi: ArrayLike, residual: ArrayLike) -> float:
    """Return the sum of squared leave-one-out residuals; NaN where one point alone determines a term."""
    h = leverage(phi)
    if np.any(h > 1 - 1e-9):
        return float("nan")
    return float(np.sum((np.asarray(residual) / (1.0 - h)) ** 2))


def lack_of_fit(
    surrogate: Surrogate,
    z: ArrayLike,
    y: ArrayLike,
    larger: Surrogate | None = None,
    z_validation: ArrayLike | None = None,
    y_validation: ArrayLike | None = None,
) -> tuple[float, float, str]:
    """Test by an F test whether the model lacks terms.

    The test is against pure error where points are replicated. Else it is against a larger model that
    contains this one (partial F test). Else it is against validation runs: with e the prediction errors and V
    = I + Phi_v (Phi'Phi)^-1 Phi_v', e'V^-1 e / (N_v sigma^2) ~ F(N_v, dof) if the model is correct. Without
    replicates sigma includes the misfit. Then a large F against validation runs proves a misfit, but a small
    F proves nothing.

    Parameters
    ----------
    surrogate : Surrogate
    z, y : array (N, n), (N,)
        Identification points.
    larger : Surrogate, optional
    z_validation, y_validation : array (N_v, n), (N_v,), optional

    Returns
    -------
    F : float
    p : float
    against : str
        ``pure error``, ``full model``, ``validation runs`` or ``nothing`` (F, p NaN).
    """
    if surrogate.status == "constant":
        return np.nan, np.nan, "nothing"
    y = np.asarray(y, dtype=float)
    rss = float(np.sum((y - surrogate.predict(z)) ** 2))
    error, error_dof = pure_error(z, y)
    if error_dof > 0 and error > 0 and surrogate.dof > error_dof:
        f = (rss - error) / (surrogate.dof - error_dof) / (error / error_dof)
        return f, float(special.fdtrc(surrogate.dof - error_dof, error_dof, f)), "pure error"
    if larger is not None and 0 < larger.dof < surrogate.dof and set(surrogate.terms) < set(larger.terms):
        more = float(np.sum((y - larger.predict(z)) ** 2))
        extra = surrogate.dof - larger.dof
        if more > 0:
            f = (rss - more) / extra / (more / larger.dof)
            return f, float(special.fdtrc(extra, larger.dof, f)), "full model"
    if z_validation is not None and y_validation is not None and len(np.asarray(y_validation)) > 0:
        if surrogate.dof > 0 and surrogate.sigma > 0:
            phi = model_matrix(z_validation, surrogate.names, surrogate.terms)
            e = np.asarray(y_validation, dtype=float) - surrogate.predict(z_validation)
            v = np.eye(len(e)) + phi @ surrogate.covariance @ phi.T / surrogate.sigma**2
            f = float(e @ np.linalg.solve(v, e)) / len(e) / surrogate.sigma**2
            return f, float(special.fdtrc(len(e), surrogate.dof, f)), "validation runs"
    return np.nan, np.nan, "nothing"


def fault_effect(surrogate: Surrogate) -> str:
    """Return the direction of the direct effect theta_0 of the fault.

    It is ``rises``, ``falls``, ``unclear`` (the 95 % interval contains 0) or ``none`` (exactly 0).
    """
    k = surrogate.terms.index(FAULT)
    value, error = surrogate.theta[k], np.sqrt(surrogate.covariance[k, k])
    if value == 0:
        return "none"
    if surrogate.dof < 1 or abs(value) <= special.stdtrit(surrogate.dof, 0.975) * error:
        return "unclear"
    return "rises" if value > 0 else "falls"


def diagnose(
    surrogate: Surrogate, z: np.ndarray, y: np.ndarray, z_validation: np.ndarray, y_validation: np.ndarray
) -> dict[str, float | int | str]:
    """Return the fit (6) on the validation points, and the in-sample diagnostics of one surrogate."""
    phi = model_matrix(z, surrogate.names, surrogate.terms)
    residual = y - surrogate.predict(z)
    h = leverage(phi)
    total = float(np.sum((y - y.mean()) ** 2))
    constant = surrogate.status == "constant"
    left = np.nan if constant else press(phi, residual)
    rss = float(residual @ residual)
    return {
        "fit": model_fit(y_validation, surrogate.predict(z_validation)) if len(y_validation) else np.nan,
        "sigma": surrogate.sigma,
        "dof": surrogate.dof,
        "r2": np.nan if constant else 1.0 - rss / total,
        "r2_adjusted": np.nan
        if constant or surrogate.dof < 1
        else 1.0 - (rss / surrogate.dof) / (total / (len(y) - 1)),
        "r2_predicted": np.nan if constant else 1.0 - left / total,
        "press": left,
        "leverage_max": float(h.max()),
        "condition": float(np.linalg.cond(phi)),
        "fault_effect": fault_effect(surrogate),
    }


def validate_surrogates(
    test_quantities: pd.DataFrame, surrogates: pd.DataFrame, max_failed_share: float = 0.05
) -> pd.DataFrame:
    """Validate every cell and model.

    Parameters
    ----------
    test_quantities : DataFrame
        Test quantities of the sets ``identification`` and ``validation``, both in the coding of the former.
    surrogates : DataFrame
        From `fit_surrogates`.
    max_failed_share : float
        Largest share of NaN test quantities in a cell.

    Returns
    -------
    DataFrame
        Keys, ``model``, ``fit`` [%] (6); ``sigma``, ``dof``, ``r2``, ``r2_adjusted``, ``r2_predicted`` (from
        ``press``), ``leverage_max``, ``condition``, ``fault_effect``, ``lack_of_fit`` (F),
        ``lack_of_fit_p``, ``lack_of_fit_against``, ``n_points``, ``n_failed``, ``n_validation``,
        ``n_validation_failed``, ``status``.

    Raises
    ------
    InputError
        Where validation rows are missing, a cell has no rows of a set, or too many points failed.
    """
    names = factor_columns(test_quantities)
    if not (test_quantities["set"] == VALIDATION).any():
        raise InputError("test quantities: no row has the set 'validation'; run the validation points.")
    points = {key: rows for key, rows in cells_of(test_quantities, ["set"])}
    records = []
    for key, cell in cells_of(surrogates):
        sets = {}
        for which in (IDENTIFICATION, VALIDATION):
            if (*key, which) not in points:
                raise InputError(f"cell {cell_name(key)}: no '{which}' rows; make the test quantities again.")
            rows = points[(*key, which)].sort_values("point")
            good = usable_points(rows, key, max_failed_share)
            sets[which] = (good[names].to_numpy(), good["y"].to_numpy(dtype=float), len(rows) - len(good))
        z, y, failed = sets[IDENTIFICATION]
        z_v, y_v, failed_v = sets[VALIDATION]
        models = {m: read_surrogate(rows) for m, rows in cell.groupby("model", sort=True, observed=True)}
        for model, surrogate in models.items():
            f, p, against = lack_of_fit(surrogate, z, y, models.get("full"), z_v, y_v)
            records.append(
                {
                    **dict(zip(CELL, key, strict=True)),
                    "model": model,
                    **diagnose(surrogate, z, y, z_v, y_v),
                    "lack_of_fit": f,
                    "lack_of_fit_p": p,
                    "lack_of_fit_against": against,
                    "n_points": len(y),
                    "n_failed": failed,
                    "n_validation": len(y_v),
                    "n_validation_failed": failed_v,
                    "status": surrogate.status,
                }
            )
    return pd.DataFrame(records)
