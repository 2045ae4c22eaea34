"""The tracer's own probability of detection: a logistic model over log size and the axes.

After MIL-HDBK-1823A: hit or miss, logit link, log size; a90 is the size found in 90 % of cases and a90/95 its
upper bound with 95 % confidence (delta method on log a90). Size is in multiples of the just findable size.
"""

from typing import Any

import numpy as np
import pandas as pd
import statsmodels.api as sm
from numpy.typing import NDArray
from scipy.stats import norm

FEWEST = 12
"""Fewest effects of which a curve is fitted."""
AXES = ("noise_level", "rate", "reversal", "encoder", "duration")
"""Axes of numbers that the surrogate has in addition to the size; the logarithm of each, centred."""


def _say_no(note: str, effects: int) -> dict[str, Any]:
    return {"effects": effects, "a90": None, "a90_95": None, "note": note, "slope": None, "axes": {}}


def find_size(
    parameters: NDArray[np.float64],
    covariance: NDArray[np.float64],
    share: float = 0.9,
    confidence: float = 0.95,
) -> tuple[float, float]:
    """Size found in a share of cases, and its upper confidence bound.

    Parameters
    ----------
    parameters : array (2,)
        Intercept and slope by log size.
    covariance : array (2, 2)
    """
    wanted = float(np.log(share / (1 - share)))
    middle, slope = float(parameters[0]), float(parameters[1])
    log_size = (wanted - middle) / slope
    gradient = np.array([-1.0 / slope, -log_size / slope])
    spread = float(np.sqrt(gradient @ covariance @ gradient))
    return float(np.exp(log_size)), float(np.exp(log_size + norm.ppf(confidence) * spread))


def fit_detection(entries: pd.DataFrame) -> dict[str, Any]:
    """Curve of detection over the separable named effects.

    Parameters
    ----------
    entries : DataFrame
        Rows of `runner.run_cases`.

    Returns
    -------
    dict
        `effects`, `a90`, `a90_95` (None with a `note` where the data do not carry a curve), `slope`, and
        `axes`: by axis, what one factor of e does to the logit, with its standard error.
    """
    if entries.empty:
        return _say_no("nothing was planted", 0)
    chosen = entries[(entries["kind"] == "planted") & ~entries["outside"].astype(bool)]
    chosen = chosen[chosen["separable"].astype(bool) & (chosen["times_findable"].astype(float) > 0)]
    chosen = chosen[np.isfinite(chosen["times_findable"].astype(float))]
    found = chosen["found"].astype(float).to_numpy()
    size = np.log(chosen["times_findable"].astype(float).to_numpy())
    if len(chosen) < FEWEST or found.min(initial=1.0) == found.max(initial=0.0):
        return _say_no(f"{len(chosen)} separable effects carry no curve", len(chosen))
    matrix = np.column_stack([np.ones_like(size), size])
    if _is_separated(size, found):
        return _say_no("hits and misses are parted by size alone", len(chosen))
    fit = sm.GLM(found, matrix, family=sm.families.Binomial()).fit()
    if not fit.params[1] > 0:
        return _say_no("detection does not grow with size", len(chosen))
    a90, bound = find_size(np.asarray(fit.params), np.asarray(fit.cov_params()))
    out = {"effects": len(chosen), "a90": a90, "a90_95": bound, "note": "", "slope": float(fit.params[1])}
    return out | {"axes": _fit_axes(chosen, matrix, found)}


def _is_separated(size: NDArray[np.float64], found: NDArray[np.float64]) -> bool:
    return bool(size[found > 0.5].min() >= size[found < 0.5].max())


def _fit_axes(
    chosen: pd.DataFrame, matrix: NDArray[np.float64], found: NDArray[np.float64]
) -> dict[str, dict[str, float]]:
    """Effect of each axis on the logit given the size; weakly ridged, so that few cases do not diverge."""
    columns, names = [], []
    for axis in AXES:
        if f"axis_{axis}" in chosen:
            values = np.log(chosen[f"axis_{axis}"].astype(float).to_numpy())
            if values.std() > 0:
                columns.append(values - values.mean())
                names.append(axis)
    whole = np.column_stack([matrix, *columns])
    beta = np.zeros(whole.shape[1])
    ridge = np.diag([1e-6, 1e-6, *np.full(len(columns), 0.1)])
    for _ in range(50):
        share = 1 / (1 + np.exp(-np.clip(whole @ beta, -30, 30)))
        hessian = (whole * (share * (1 - share))[:, None]).T @ whole + ridge
        step = np.linalg.solve(hessian, whole.T @ (found - share) - ridge @ beta)
        beta = beta + step
        if np.abs(step).max() < 1e-8:
            break
    error = np.sqrt(np.diag(np.linalg.inv(hessian)))
    return {
        name: {"by_factor_e": float(beta[i]), "standard_error": float(error[i])}
        for i, name in enumerate(names, start=2)
    }
