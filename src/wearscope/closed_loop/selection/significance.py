"""Significance by random signs of blocks: one statistic, one distribution, one correction for all tried."""

from collections.abc import Sequence

import numpy as np
from scipy import stats


def make_flips(count: int, blocks: int, seed: int) -> np.ndarray:
    """Random signs (count, blocks)."""
    return np.random.default_rng(np.random.SeedSequence([seed, blocks])).choice([-1.0, 1.0], (count, blocks))


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


def tail(observed: np.ndarray | float, chance: np.ndarray) -> np.ndarray:
    """Logarithm of the tail probability of statistics under a gamma law with chance's mean and variance."""
    mean, variance = max(float(chance.mean()), 1e-300), max(float(chance.var()), 1e-300)
    return stats.gamma.logsf(observed, mean**2 / variance, scale=variance / mean)


def adjust(observed: Sequence[float], chance: Sequence[np.ndarray], tried: Sequence[float]) -> np.ndarray:
    """Family-wise p-values: the least tail over all candidates against its distribution under random signs.

    Tails make candidates with different numbers of columns and shapes comparable (Westfall and Young 1993,
    minP).

    Parameters
    ----------
    observed : sequence of float
        Statistic of each candidate.
    chance : sequence of ndarray (F,)
        The same under random signs, the same ones for all.
    tried : sequence of float
        How many shapes each was chosen from beyond those that `chance` went through (Bonferroni).
    """
    if not len(observed):
        return np.zeros(0)
    own = np.array([float(tail(value, law)) for value, law in zip(observed, chance, strict=True)])
    lowest = np.min([tail(law, law) for law in chance], axis=0)
    ordered = np.sort(lowest)
    # Few blocks give the observed signs again, but for rounding.
    own = np.minimum(own * (1.0 - 1e-6) + np.log(np.asarray(tried, dtype=float)), 0.0)
    return (1.0 + np.searchsorted(ordered, own, side="right")) / (len(ordered) + 1.0)


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
