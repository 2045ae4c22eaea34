"""Changes over the sessions: since when they count, and how fast they grow."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import statsmodels.api as sm

#: Penalty of a change point, in the noise's variance times the logarithm of the number of sessions: the
#: modified Bayesian information criterion of a level and a place (Zhang and Siegmund 2007).
_PENALTY = 3.0
#: Fewest sessions that show a trend.
_LEAST_SESSIONS = 4


@dataclass(frozen=True)
class Trend:
    """A straight line through the sessions' estimates, by weighted least squares with HC3 errors.

    Attributes
    ----------
    slope : float
        By session.
    low, high : float
        95 % interval.
    p_value : float
        Of no slope.
    """

    slope: float
    low: float
    high: float
    p_value: float


def find_segments(values: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Segment (S,) of each session between change points of a level (Jackson et al. 2005, IEEE SPL 12).

    Parameters
    ----------
    values, errors : ndarray (S,)
        Estimates and their standard errors; NaN where a session shows none, which belongs to the one before.
    """
    known = np.isfinite(values) & np.isfinite(errors)
    segment = np.zeros(len(values), dtype=int)
    if known.sum() < 2:
        return segment
    # In the usual noise's unit; sessions that say less than the usual one weigh less.
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
    """Segments of the sessions after the first `healthy` ones; each that is on their level by itself.

    Parameters
    ----------
    segments : ndarray (S,)
        Of all sessions, healthy ones first.
    healthy : int
    """
    level = segments[healthy - 1] if healthy else -1
    return [-2 - k if s == level else int(s) for k, s in enumerate(segments[healthy:])]


def find_since(counting: Sequence[bool], segments: Sequence[int], session: int) -> int:
    """First session from which a change that counts in `session` does.

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


def fit_trend(values: np.ndarray, errors: np.ndarray) -> Trend | None:
    """Straight line through estimates (S,) with standard errors (S,); None of fewer than four sessions."""
    known = np.isfinite(values) & np.isfinite(errors) & (errors > 0)
    if known.sum() < _LEAST_SESSIONS:
        return None
    x = sm.add_constant(np.flatnonzero(known).astype(float))
    fit = sm.WLS(values[known], x, weights=1.0 / errors[known] ** 2).fit(cov_type="HC3", use_t=True)
    low, high = fit.conf_int()[1]
    return Trend(float(fit.params[1]), float(low), float(high), float(fit.pvalues[1]))
