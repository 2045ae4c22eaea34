"""Changes over the sessions: from which session on they show, and how fast they grow."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import statsmodels.api as sm
from scipy import stats

#: Penalty of a change point, in the noise's variance times the logarithm of the number of sessions: the
#: modified Bayesian information criterion of a level and a place (Zhang and Siegmund 2007).
_PENALTY = 3.0
#: Rise of friction, as a share of the healthy one, that a machine may have where none is stated.
FRICTION_LIMIT = 0.3
#: Fewest sessions that show a trend.
_LEAST_SESSIONS = 4


@dataclass(frozen=True)
class Trend:
    """A straight line through the sessions' estimates, by weighted least squares with HC3 errors.

    Attributes
    ----------
    slope : float
        Slope per session.
    low, high : float
        95 % interval of the slope.
    p_value : float
        p-value of the hypothesis that the slope is zero.
    left : tuple of float
        Number of sessions after the last one until the line reaches a limit, with the ends of its 95 %
        interval (Fieller 1954, J. R. Stat. Soc. B 16); NaN where the line does not surely rise.
    """

    slope: float
    low: float
    high: float
    p_value: float
    left: tuple[float, float, float]


def find_segments(values: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Number (S,) of each session's segment; segments lie between change points of the level.

    The change points are optimal for a penalised sum of squares (Jackson et al. 2005, IEEE SPL 12).

    Parameters
    ----------
    values, errors : ndarray (S,)
        Estimates and their standard errors. A session without (NaN) belongs to the segment of the one before.
    """
    known = np.isfinite(values) & np.isfinite(errors)
    segment = np.zeros(len(values), dtype=int)
    if known.sum() < 2:
        return segment
    # Estimates are scaled by their standard errors, so that less certain sessions have less weight; the
    # median error is the least that counts.
    signal = values[known] / np.maximum(errors[known], np.median(errors[known]))
    signal -= signal.mean()
    penalty = _PENALTY * np.log(len(signal))
    total, squares = (np.concatenate([[0.0], np.cumsum(x)]) for x in (signal, signal**2))
    least, start = np.zeros(len(signal) + 1), np.zeros(len(signal) + 1, dtype=int)
    for end in range(1, len(signal) + 1):
        k = np.arange(end)
        costs = least[:end] + squares[end] - squares[:end] - (total[end] - total[:end]) ** 2 / (end - k)
        start[end] = np.argmin(costs)
        least[end] = costs[start[end]] + penalty
    own = np.zeros(len(signal), dtype=int)
    begin = start[-1]
    while begin > 0:
        own[begin:] += 1
        begin = start[begin]
    place = np.maximum.accumulate(np.where(known, np.cumsum(known) - 1, 0))
    return own[place]


def leave_healthy(segments: np.ndarray, healthy: int) -> list[int]:
    """Segments of the later sessions; a session on the healthy level is a segment of its own.

    Parameters
    ----------
    segments : ndarray (S,)
        Segments of all sessions, healthy ones first.
    healthy : int
        Number of healthy sessions.
    """
    level = segments[healthy - 1] if healthy else -1
    return [-2 - k if s == level else int(s) for k, s in enumerate(segments[healthy:])]


def find_since(counting: Sequence[bool], segments: Sequence[int], session: int) -> int:
    """Index of the session since which a change that counts in `session` has counted.

    Parameters
    ----------
    counting : sequence of bool
        Whether the change counts in each session.
    segments : sequence of int
        Segment of each session.
    session : int
    """
    start = session
    while start > 0 and (counting[start - 1] or segments[start - 1] == segments[start]):
        start -= 1
    return start


def fit_trend(values: np.ndarray, errors: np.ndarray, limit: float) -> Trend | None:
    """Straight line through estimates (S,) with standard errors (S,); None for fewer than four sessions."""
    known = np.isfinite(values) & np.isfinite(errors) & (errors > 0)
    if known.sum() < _LEAST_SESSIONS:
        return None
    x = sm.add_constant(np.flatnonzero(known).astype(float))
    fit = sm.WLS(values[known], x, weights=1.0 / errors[known] ** 2).fit(cov_type="HC3", use_t=True)
    low, high = fit.conf_int()[1]
    left = np.full(3, np.nan)
    if low > 0.0:
        (start, slope), covariance = fit.params - [limit, 0.0], fit.cov_params()
        square = stats.t.isf(0.025, fit.df_resid) ** 2
        ends = np.roots(
            [
                slope**2 - square * covariance[1, 1],
                2.0 * (start * slope - square * covariance[0, 1]),
                start**2 - square * covariance[0, 0],
            ]
        )
        left = np.array([-start / slope, *np.sort(ends.real)]) - (len(values) - 1)
    return Trend(float(fit.params[1]), float(low), float(high), float(fit.pvalues[1]), tuple(left.tolist()))
