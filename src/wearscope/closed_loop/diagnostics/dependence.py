"""What a residual looks like, and which signals it depends on, whatever the form of the dependence."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
from scipy import signal, stats
from statsmodels.stats.diagnostic import acorr_ljungbox

from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.intake.signals import thin_signals
from wearscope.closed_loop.model.blocks import Folds
from wearscope.closed_loop.model.prediction import Predicted, relative_error, rms
from wearscope.closed_loop.model.regression import (
    Regression,
    block_scores,
    cross_validate_family,
    partial_fit,
)

#: Hat functions of a linear spline.
KNOTS = 8
#: Rows of the whiteness test come at this share of the common cut-off or slower: the common filter, an
#: order-4 Butterworth run both ways, then leaves white noise a correlation of less than 0.05.
_WHITE = 0.87
_LAGS = 10
_LEAST_ROWS = 30
_DIRECTION = "sign_qd"

DIAGNOSTIC_UNITS = {
    "relative_error": "%",
    "peak": "Hz",
    "bandwidth": "Hz",
    "ljung_box_p": "1",
    "lag_correlation": "1",
}
DEPENDENCE_UNITS = {"share": "1", "share_held_out": "1", "p_value": "1", "p_adjusted": "1"}


def diagnose_residuals(prepared: Prepared, predicted: list[Predicted]) -> pd.DataFrame:
    """Size, spectrum and whiteness of every residual.

    Parameters
    ----------
    prepared : Prepared
    predicted : list of Predicted
        Of every run.

    Returns
    -------
    DataFrame
        One row a joint, run and stage: `rms`, `relative_error` [%], `peak` (frequency of the largest spectral
        density) and `bandwidth` (below which 90 % of the power lies) [Hz], `lag_correlation` and
        `ljung_box_p` (Ljung and Box 1978, over ten lags) of the residual thinned so that white noise through
        the common filter would be nearly white. NaN where fewer than thirty rows count.
    """
    band = prepared.band
    rate = band.rate / band.stride
    every = int(np.ceil(rate / (_WHITE * band.torque)))
    records = []
    for p in predicted:
        for stage in ("before", "after"):
            residual = p.run.measured - getattr(p, stage)
            size = rms(residual, p.run.keep)
            relative = relative_error(residual, p.run.measured, p.run.keep)
            for j, joint in enumerate(prepared.dataset.joints):
                keep = p.run.keep[:, j]
                records.append(
                    {
                        "joint": joint,
                        "run": p.run.file,
                        "use": p.run.use,
                        "stage": stage,
                        "rms": size[j],
                        "relative_error": relative[j],
                        **_describe_spectrum(residual[:, j] * keep, rate, int(keep.sum())),
                        **_test_whiteness(residual[keep, j][::every]),
                    }
                )
    return pd.DataFrame(records)


def _describe_spectrum(residual: np.ndarray, rate: float, count: int) -> dict[str, float]:
    if count < _LEAST_ROWS or not residual.any():
        return {"peak": np.nan, "bandwidth": np.nan}
    frequency, density = signal.welch(residual, rate, nperseg=min(len(residual), int(8 * rate)))
    power = np.cumsum(density[1:])
    return {
        "peak": float(frequency[1 + np.argmax(density[1:])]),
        "bandwidth": float(frequency[1 + np.searchsorted(power, 0.9 * power[-1])]),
    }


def _test_whiteness(residual: np.ndarray) -> dict[str, float]:
    if len(residual) < _LEAST_ROWS or not np.ptp(residual) > 0.0:
        return {"lag_correlation": np.nan, "ljung_box_p": np.nan}
    test = acorr_ljungbox(residual, lags=[_LAGS])
    centred = residual - residual.mean()
    return {
        "lag_correlation": float(centred[1:] @ centred[:-1] / (centred @ centred)),
        "ljung_box_p": float(test["lb_pvalue"].iloc[0]),
    }


def code_signals(run: PreparedRun) -> dict[str, np.ndarray]:
    """Signals (M, n) of a run at the rows of its residual, by code; time (M, 1) since its start."""
    thin = thin_signals(run)
    since = (thin.t - run.signals.t[0])[:, None]
    return {
        "q": thin.q,
        "qd": thin.v,
        "qdd": thin.a,
        "load": thin.load,
        "temp": thin.temperature,
        _DIRECTION: thin.sign,
        "t": since,
    }


def _list_signals(joint: int, n: int) -> Iterator[tuple[str, int, bool]]:
    """Code, joint, and whether times the direction of motion."""
    for code in ("q", "qd", "qdd", "load", "temp", "t"):
        for directed in (False, True):
            yield code, joint, directed
    for other in [joint, *(k for k in range(n) if k != joint)]:
        yield _DIRECTION, other, False
        if other != joint:
            for code in ("q", "qd", "qdd", "load"):
                yield code, other, False


def _hats(x: np.ndarray, low: float, high: float) -> np.ndarray:
    """Linear B-splines (M, KNOTS), held constant outside [low, high]."""
    place = np.clip((x - low) / (high - low), 0.0, 1.0) * (KNOTS - 1)
    return np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(KNOTS)))


def spline_family(
    prepared: Prepared, thinned: list[dict[str, np.ndarray]], joint: int
) -> tuple[list[str], list[np.ndarray]]:
    """Splines of every signal that a residual may depend on.

    Parameters
    ----------
    prepared : Prepared
    thinned : list of dict
        `code_signals` of each training run.
    joint : int

    Returns
    -------
    names : list of str
        As ``depends_on`` has them, ``q_<joint> sign_qd_<joint>`` for a product with the direction.
    columns : list of ndarray (M, len(names) * KNOTS)
        Of each training run.
    """
    joints = prepared.dataset.joints
    names: list[str] = []
    parts: list[list[np.ndarray]] = [[] for _ in thinned]
    for code, source, directed in _list_signals(joint, len(joints)):
        column = 0 if code == "t" else source
        every = np.concatenate([run[code][:, column] for run in thinned])
        if not np.isfinite(every).all():
            continue
        low, high = np.quantile(every, [0.002, 0.998])
        if not high - low > 1e-9 * (1.0 + abs(high)):
            continue
        name = "t" if code == "t" else f"{code}_{joints[source]}"
        names.append(f"{name} {_DIRECTION}_{joints[joint]}" if directed else name)
        for part, run in zip(parts, thinned, strict=True):
            x = _hats(run[code][:, column], low, high)
            part.append(x * run[_DIRECTION][:, [joint]] if directed else x)
    return names, [np.concatenate(part, axis=1) for part in parts]


def find_dependence(
    prepared: Prepared, models: dict[str, Regression], folds: Folds, flips: np.ndarray
) -> pd.DataFrame:
    """Which signals the residuals of the training runs depend on, free of any form.

    A linear spline of each signal is fitted beside the model, whose own parameters are refitted. Its p-value
    comes from the same score under random signs of blocks of rows, which keep the residual's own
    correlation; adjusted, it is that of the best signal of the joint (Westfall and Young 1993, minP).

    Parameters
    ----------
    prepared : Prepared
    models : dict of str to Regression
        By stage.
    folds : Folds
    flips : ndarray (F, B)
        Random signs by block.

    Returns
    -------
    DataFrame
        One row a joint, stage and signal: `share` of the residual's variance that the spline explains,
        `share_held_out` the same on held-out runs (negative where it only fits noise), `p_value`,
        `p_adjusted`.
    """
    thinned = [code_signals(run) for run in prepared.runs_for("train")]
    tables = []
    for j in np.flatnonzero(prepared.moving):
        names, columns = spline_family(prepared, thinned, int(j))
        for stage, model in models.items():
            table = _test_signals(model, columns, int(j), folds, flips)
            table.insert(0, "joint", prepared.dataset.joints[j])
            table.insert(1, "stage", stage)
            table.insert(2, "signal", names)
            tables.append(table)
    return pd.concat(tables, ignore_index=True)


def _test_signals(
    model: Regression, columns: list[np.ndarray], joint: int, folds: Folds, flips: np.ndarray
) -> pd.DataFrame:
    family = model.correlate(columns, joint, KNOTS)
    fit = partial_fit(model, family)
    scores = block_scores(model, family)
    residuals = model.residuals(model.solve())
    loss = sum(((r * w)[:, joint] ** 2).sum() for r, w in zip(residuals, model.weights, strict=True))
    held_out = model.cross_validate_joints(folds)[joint]
    inverse = np.linalg.inv(fit.inner)
    flipped = np.tensordot(flips, scores, axes=(1, 0))
    chance = np.einsum("fsm,smn,fsn->fs", flipped, inverse, flipped, optimize=True)
    mean, variance = chance.mean(axis=0), np.maximum(chance.var(axis=0), 1e-300)
    law = stats.gamma(mean**2 / variance, scale=variance / np.maximum(mean, 1e-300))
    p = law.sf(fit.gain)
    least = np.sort(law.sf(chance).min(axis=1))
    base = model.cross_validate(folds)
    gain = [float(np.nansum(base - cross_validate_family(model, family.at(k), folds))) for k in range(len(p))]
    return pd.DataFrame(
        {
            "share": fit.gain / max(float(loss), 1e-300),
            "share_held_out": np.array(gain) / max(float(held_out), 1e-300),
            "p_value": p,
            "p_adjusted": (1 + np.searchsorted(least, p, side="right")) / (len(least) + 1),
        }
    )
