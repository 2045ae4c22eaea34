"""Significance beside a residual that drifts: all is filtered so that what is left is white.

A torque that drifts looks like a slow signal far more often than independent noise does. The filter that
makes the residual white takes the drift out of the regressors too; what then remains of an effect is what no
drift imitates (generalised least squares with an autoregressive residual; Cochrane and Orcutt 1949). The
level of a drift is another one in every run, which runs are too few to tell from an effect's.
"""

from copy import copy

import numpy as np
from scipy import linalg, signal, stats

from wearscope.closed_loop.model.regression import Entry, Regression, Regressors, block_scores, partial_fit
from wearscope.closed_loop.selection.evidence import ISOLABLE, find_memory

#: Memory of the filter, as a share of the shortest run.
_MEMORY = 0.125
#: Ridge of the filter, of the residual's power, so that it does not lift what the common filter has cut off.
_FLOOR = 1e-3


def drift_p_value(model: Regression, entry: Entry, flips: np.ndarray) -> float:
    """p-value of an effect beside a drift of what it leaves, with that made white.

    Parameters
    ----------
    model : Regression
    entry : Entry
    flips : ndarray (F, B)
        Random signs of the blocks.

    Returns
    -------
    float
        Of the gain against those under random signs, as a gamma distribution with their mean and variance; 0
        where what is left at the effect's joints does not drift, 1 where a drift's levels absorb the effect.
    """
    columns = [run.reduce(entry.columns(run)) for run in model.prepared.runs_for("train")]
    left = leave(model, columns, entry)
    drifting = find_drifts(model, left)
    if not any(drifting[j] and any(x[:, j].any() for x in columns) for j in range(model.prepared.n)):
        return 0.0
    white, columns = whiten(model, columns, left, drifting)
    regressors = _correlate(white, columns, entry)
    fit = partial_fit(white, regressors)
    inner, beta = fit.inner[0], fit.beta[0]
    if beta @ inner @ beta < ISOLABLE**2 * (beta @ regressors.gram[:, 0].sum(axis=0) @ beta):
        return 1.0
    turned = flips @ block_scores(white, regressors)[:, 0]
    chance = np.einsum("fm,mn,fn->f", turned, np.linalg.inv(inner), turned)
    mean, variance = chance.mean(), chance.var()
    return float(stats.gamma.sf(fit.gain[0], mean**2 / variance, scale=variance / mean))


def find_drifts(model: Regression, left: list[np.ndarray]) -> np.ndarray:
    """Joints (n,) at which the residual `left` (M, n) of the runs remembers for longer than a block."""
    run_of = np.array([block.run for block in model.blocks])
    sums = np.array([left[block.run][block.start : block.stop].sum(axis=0) for block in model.blocks])
    return np.array([find_memory(own, run_of) > 1 for own in sums.T])


def _correlate(model: Regression, columns: list[np.ndarray], entry: Entry) -> Regressors:
    regressors = model.correlate(columns, entry.joint, len(entry.subset))
    return regressors.combine(np.eye(len(entry.subset))) if entry.effect.name == "unknown" else regressors


def leave(model: Regression, columns: list[np.ndarray], entry: Entry) -> list[np.ndarray]:
    """Residual (M, n) of each training run beside a model and an entry with `columns`; zero where masked."""
    regressors = _correlate(model, columns, entry)
    beta = partial_fit(model, regressors).beta[0]
    gram, score = model.moments()
    theta = np.linalg.solve(gram, score - regressors.cross.sum(axis=0)[0].T @ beta)
    return [
        (r - x @ beta) * (w > 0)
        for r, x, w in zip(model.residuals(theta), columns, model.weights, strict=True)
    ]


def whiten(
    model: Regression, columns: list[np.ndarray], left: list[np.ndarray], drifting: np.ndarray
) -> tuple[Regression, list[np.ndarray]]:
    """The regression and further columns (M, n, m), filtered so that the residual `left` is white.

    Where it is `drifting`, every run has a level of its own.
    """
    length = int(_MEMORY * min(len(r) for r in left))
    joints = range(model.prepared.n)
    filters = [find_filter([r[:, j] for r in left], length) for j in joints]

    def apply(x: np.ndarray, w: np.ndarray) -> np.ndarray:
        x = x * (w > 0).reshape(*w.shape, *[1] * (x.ndim - 2))
        return np.stack([signal.lfilter(filters[j], 1.0, x[:, j], axis=0) for j in joints], axis=1)

    weights = [(w > 0) * (np.arange(len(w)) >= length)[:, None] for w in model.weights]
    rest = sum((apply(x, w) ** 2).sum(axis=0) for x, w in zip(left, weights, strict=True))
    sigma = np.sqrt(np.maximum(rest / np.maximum(sum(w.sum(axis=0) for w in weights), 1), 1e-24))
    white = copy(model)
    white.weights = [w / sigma for w in weights]
    white.target = [apply(y, w) for y, w in zip(model.target, model.weights, strict=True)]
    white.columns = []
    for r, (x, w) in enumerate(zip(model.columns, model.weights, strict=True)):
        levels = np.zeros((*w.shape, len(left), len(drifting)))
        levels[:, drifting, r, drifting] = 1.0
        levels = levels[..., drifting].reshape(*w.shape, -1)
        white.columns.append(apply(np.concatenate([x, levels], axis=2), w))
    white.sum_blocks()
    return white, [apply(x, w) for x, w in zip(columns, model.weights, strict=True)]


def find_filter(series: list[np.ndarray], length: int) -> np.ndarray:
    """Filter (length + 1,) that makes series white: what an autoregression of their past leaves of them.

    Parameters
    ----------
    series : list of ndarray (M,)
    length : int
        Order of the autoregression, fitted by least squares.
    """
    windows = np.concatenate([np.lib.stride_tricks.sliding_window_view(x, length + 1) for x in series])
    past, now = windows[:, -2::-1], windows[:, -1]
    power = float((now**2).sum())
    if power <= 0.0:
        return np.eye(1, length + 1)[0]
    gram = past.T @ past + _FLOOR * power * np.eye(length)
    return np.concatenate([[1.0], -linalg.solve(gram, past.T @ now, assume_a="pos")])
