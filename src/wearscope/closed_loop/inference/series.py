"""A residual as a series: averaged, without knocks, made white, and what columns leave of it."""

import numpy as np
from scipy import linalg, ndimage, signal
from statsmodels.regression.linear_model import burg

#: Longest memory of the autoregression [rows], chosen by Schwarz's criterion.
_MEMORY = 6
#: Knocks: rows of the running median, and distance from it at which a row is cut off [standard deviations].
_AROUND, _CUT = 9, 3.0


def average(every: int, *series: np.ndarray) -> tuple[np.ndarray, ...]:
    """Means of series (M,) over `every` rows each; fewer rows at the end do not count."""
    return tuple(x[: len(x) // every * every].reshape(-1, every).mean(axis=1) for x in series)


def bend_line(rows: int, bends: int) -> np.ndarray:
    """Columns (rows, bends + 2) of a piecewise linear function with equidistant bends."""
    knots = np.linspace(0.0, rows - 1.0, bends + 2)
    return np.column_stack([np.interp(np.arange(rows), knots, unit) for unit in np.eye(len(knots))])


def leave(columns: np.ndarray, x: np.ndarray, whiten: np.ndarray) -> float:
    """Sum of squares that columns (M, m) leave of a series (M,), all filtered by `whiten` (1 + P,)."""
    every = signal.lfilter(whiten, 1.0, np.column_stack([columns, x]), axis=0)[len(whiten) - 1 :]
    fit = np.linalg.lstsq(every[:, :-1], every[:, -1], rcond=None)[0]
    return float(np.sum((every[:, -1] - every[:, :-1] @ fit) ** 2))


def cut_knocks(x: np.ndarray) -> np.ndarray:
    """A series (M,) whose rows keep to a few deviations of all about a running median."""
    middle = ndimage.median_filter(x, _AROUND, mode="nearest")
    most = _CUT * 1.4826 * float(np.median(np.abs(x - middle)))
    return np.asarray(middle + np.clip(x - middle, -most, most))


def find_whitening(x: np.ndarray) -> np.ndarray:
    """Filter (1 + P,) that makes a series (M,) white: an autoregression by Burg's method.

    An autoregression from the autocovariances would underestimate a memory near the series' length.
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


def take_out(columns: np.ndarray, known: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Residual of columns after a model's columns, whose coefficients are partly known.

    Parameters
    ----------
    columns : ndarray (M, p)
    known : ndarray (p, p)
        Information on their coefficients, in squares of what the columns are in.
    x : ndarray (M, k)

    Returns
    -------
    ndarray (M, k)
    """
    values, vectors = np.linalg.eigh(known)
    hold = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    scale = np.sqrt(np.maximum((columns**2).sum(axis=0) + np.diag(known), 1e-300))
    free = np.zeros((len(known), x.shape[1]))
    onto = linalg.lstsq(np.vstack([columns / scale, hold / scale]), np.vstack([x, free]), cond=1e-9)[0]
    return np.asarray(x - (columns / scale) @ onto)


def bridge_uncounted(x: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """Columns (M, P) of a run with straight lines across the rows (M,) that do not count.

    The torque and every regressor alike, so that their relation holds there too: zeros would put steps into a
    torque that drifts, and the same ones into the regressors.
    """
    at = np.flatnonzero(keep)
    if len(at) in (0, len(keep)):
        return x * keep[:, None]
    rows = np.arange(len(keep))
    after = np.minimum(np.searchsorted(at, rows), len(at) - 1)
    before = np.maximum(after - (at[after] > rows), 0)
    span = np.maximum(at[after] - at[before], 1)
    share = np.clip((rows - at[before]) / span, 0.0, 1.0)[:, None]
    return (1.0 - share) * x[at[before]] + share * x[at[after]]
