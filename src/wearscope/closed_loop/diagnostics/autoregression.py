"""A residual's own memory: the filter that makes it white, and what knocks hide of it."""

import numpy as np
from scipy import ndimage
from statsmodels.regression.linear_model import burg

#: Longest memory of the autoregression [rows], chosen by Schwarz's criterion.
_MEMORY = 6
#: Knocks: rows of the running median beside which a row is cut off, and where, in deviations of all.
_AROUND, _CUT = 9, 3.0


def cut_knocks(x: np.ndarray) -> np.ndarray:
    """A series (M,) whose rows keep to a few deviations of all about a running median."""
    middle = ndimage.median_filter(x, _AROUND, mode="nearest")
    most = _CUT * 1.4826 * float(np.median(np.abs(x - middle)))
    return np.asarray(middle + np.clip(x - middle, -most, most))


def find_whitening(x: np.ndarray) -> np.ndarray:
    """Filter (1 + P,) that makes a series (M,) white: an autoregression by Burg's method.

    That of the autocovariances takes memory for shorter than it is where that is near the series' length.
    """
    best, lowest = np.ones(1), float(np.log(max(np.var(x), 1e-300)))
    if not np.ptp(x) > 0.0:
        return best
    for order in range(1, _MEMORY + 1):
        rho, variance = burg(x, order)
        criterion = float(np.log(max(variance, 1e-300))) + (order + 1) * np.log(len(x)) / len(x)
        if criterion < lowest:
            best, lowest = np.concatenate([[1.0], -rho]), criterion
    return best
