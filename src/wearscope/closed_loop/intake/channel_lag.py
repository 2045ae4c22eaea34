"""By how much the torque channels of a recording lag its positions."""

import numpy as np
from scipy import interpolate

from wearscope.closed_loop.intake.channel_hypotheses import LEAST_ROWS, Sample
from wearscope.closed_loop.intake.rough_model import rough_columns


def _misfits_at(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Share of the variance of each column of y (K, L) that free coefficients of x (K, P) leave (L,)."""
    basis = np.linalg.qr(x)[0]
    y = y - y.mean(axis=0)
    return 1.0 - ((basis.T @ y) ** 2).sum(axis=0) / np.maximum((y**2).sum(axis=0), 1e-300)


def find_lag(sample: Sample, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Time by which each joint's torque lags its motion, and the misfit there over that without a lag.

    Parameters
    ----------
    sample : Sample
    longest : float
        Longest lag either way [s].

    Returns
    -------
    lag, ratio : ndarray (n,)
        [s]; NaN for joints that say nothing.
    """
    known = sample.known()
    reach = int(longest * sample.rate)
    lags, ratios = np.full(sample.n, np.nan), np.full(sample.n, np.nan)
    inner = np.arange(reach + 1, len(sample.q) - reach - 1)
    for j in np.flatnonzero(sample.heard).tolist():
        at = inner[sample.counts[inner, j]]
        if len(at) < LEAST_ROWS:
            continue
        x = rough_columns(known[at, j], sample.a[at, j], sample.sign[at, j], sample.v[at, j])
        between = interpolate.CubicSpline(np.arange(len(sample.tau)), sample.tau[:, j])
        shifts = np.arange(-reach, reach + 1).astype(float)
        left = _misfits_at(x, between(at[:, None] + shifts))
        near = shifts[int(np.argmin(left))] + np.linspace(-1.0, 1.0, 41)
        fine = _misfits_at(x, between(at[:, None] + near))
        lags[j] = near[int(np.argmin(fine))] / sample.rate
        ratios[j] = fine.min() / max(left[reach], 1e-300)
    return lags, ratios
