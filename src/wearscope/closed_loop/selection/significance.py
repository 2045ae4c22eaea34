"""Significance by random signs of blocks: one statistic, one distribution, one correction for all tried."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy import stats


@lru_cache(maxsize=2)
def make_flips(count: int, blocks: int, seed: int) -> np.ndarray:
    """Random signs (count, blocks), the same array whenever they are asked for; read only."""
    signs = np.random.default_rng(np.random.SeedSequence([seed, blocks])).choice([-1.0, 1.0], (count, blocks))
    signs.flags.writeable = False
    return signs


def flip_scores(scores: np.ndarray, inner: np.ndarray, flips: np.ndarray) -> tuple[float, np.ndarray]:
    """Largest reduction of the loss over the shapes, and the same when blocks change sign at random, (F,).

    Effective scores, with the model projected out, keep their distribution when a block's residual changes
    its sign (Hemerik, Goeman and Finos 2020, JRSS B 82).

    Parameters
    ----------
    scores : ndarray (B, S, m)
    inner : ndarray (S, m, m)
        Gram matrices with the model projected out.
    flips : ndarray (F, B)
    """
    inverse = np.linalg.inv(inner)
    total = scores.sum(axis=0)
    observed = float(np.einsum("sm,smn,sn->s", total, inverse, total).max())
    flipped = np.zeros(len(flips))
    for s in range(scores.shape[1]):
        turned = flips @ scores[:, s]
        flipped = np.maximum(flipped, np.einsum("fm,fm->f", turned @ inverse[s], turned))
    return observed, flipped


def score_chance(observed: np.ndarray | float, chance: np.ndarray) -> np.ndarray:
    """Normal scores of statistics under a gamma law with chance's mean and variance.

    By the cube root (Wilson and Hilferty 1931), which is monotone and makes candidates with different numbers
    of columns and shapes comparable.
    """
    mean = max(float(chance.mean()), 1e-100)
    ninth = max(float(chance.var()) / mean**2, 1e-12) / 9.0
    return (np.cbrt(np.maximum(np.asarray(observed), 0.0) / mean) - (1.0 - ninth)) / np.sqrt(ninth)


def find_ratio(score: float, columns: int) -> float:
    """Least ratio of a statistic to its mean under random signs, of so many columns, at a normal score.

    The inverse of `score_chance` where the signs give the statistic a chi-squared law.
    """
    ninth = 2.0 / (9.0 * columns)
    return float((score * np.sqrt(ninth) + 1.0 - ninth) ** 3)


def find_critical(errors: float, blocks: np.ndarray | float) -> np.ndarray:
    """Standard errors from which a sum is told from noise, where so many blocks inform on it effectively.

    As far out in Student's t with as many degrees of freedom, less one, as `errors` are in normal noise.
    """
    free = np.maximum(np.asarray(blocks, dtype=float) - 1.0, 1.0)
    return np.array([_find_quantile(errors, x) for x in free.ravel().tolist()]).reshape(free.shape)


@lru_cache(maxsize=4096)
def _find_quantile(errors: float, free: float) -> float:
    """Quantile of Student's t with so many degrees of freedom, as far out as `errors` are in normal noise."""
    return float(stats.t.ppf(stats.norm.cdf(errors), free))


def adjust(observed: Sequence[float], chance: Sequence[np.ndarray], tried: Sequence[float]) -> np.ndarray:
    """Family-wise p-values: the largest score over all candidates against that under random signs.

    Westfall and Young 1993, minP.

    Parameters
    ----------
    observed : sequence of float
        Normal score of each candidate's statistic.
    chance : sequence of ndarray (F,)
        The same under random signs, the same ones for all.
    tried : sequence of float
        How many shapes each was chosen from beyond those that `chance` went through (Bonferroni).
    """
    if not len(observed):
        return np.zeros(0)
    highest = np.sort(np.max(np.asarray(chance), axis=0))
    # Few blocks give the observed signs again, except for rounding.
    log_p = np.minimum(stats.norm.logsf(observed) * (1.0 - 1e-6) + np.log(tried), np.log(1.0 - 1e-16))
    scores = stats.norm.isf(np.exp(np.maximum(log_p, -700.0)))
    above = len(highest) - np.searchsorted(highest, scores, side="left")
    return (1.0 + above) / (len(highest) + 1.0)


def find_memory(left: np.ndarray, run: np.ndarray, remembered: float = 0.2) -> int:
    """Blocks over which a residual is autocorrelated: twice as many as exceed a correlation.

    Parameters
    ----------
    left : ndarray (B,)
        Sums of the residual by block.
    run : ndarray (B,)
    remembered : float
        The correlation.

    Returns
    -------
    int
        1 where blocks are independent; all of a run's blocks where more than a sixth of the shortest run is
        correlated.
    """
    count = np.bincount(run)
    count = count[count > 0]
    whole, shortest = int(count.max()), int(count.min())
    power = max(float((left**2).mean()), 1e-300)
    for lag in range(1, shortest // 12 + 2):
        same = run[lag:] == run[:-lag]
        if not same.any() or float((left[lag:] * left[:-lag])[same].mean()) < remembered * power:
            length = 2 * lag - 1
            return length if 6 * length <= shortest or length == 1 else whole
    return whole


def join_blocks(run: np.ndarray, length: int) -> np.ndarray:
    """First block (B,) of the group of `length` blocks that each block belongs to, within its run."""
    first = np.searchsorted(run, run)
    return first + (np.arange(len(run)) - first) // length * length
