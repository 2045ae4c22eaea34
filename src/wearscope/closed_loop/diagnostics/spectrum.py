"""What a residual looks like: its size, spectrum and whiteness."""

import numpy as np
import pandas as pd
from scipy import signal
from statsmodels.stats.diagnostic import acorr_ljungbox

from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.prediction import Predicted, relative_error, rms

#: Rows of the whiteness test come at this share of the common cut-off or slower: the common filter, an
#: order-4 Butterworth run both ways, then leaves white noise a correlation of less than 0.05.
_WHITE = 0.87
_LAGS = 10
_LEAST_ROWS = 30

UNITS = {
    "relative_error": "%",
    "peak": "Hz",
    "bandwidth": "Hz",
    "ljung_box_p": "1",
    "lag_correlation": "1",
}


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
