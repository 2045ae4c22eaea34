"""Significance on a residual that drifts: all is filtered so that what is left is white.

A torque that drifts resembles a slow signal far more often than independent noise does. The filter that makes
the residual white takes the drift out of the regressors too; what then remains of a term is what no drift
imitates (generalised least squares with an autoregressive residual; Cochrane and Orcutt 1949). The level of a
drift is another one in every run, which runs are too few to tell from a term's.
"""

from itertools import pairwise

import numpy as np
from scipy import linalg, signal, stats

from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.evidence import Evidence, weigh
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.problem import Problem
from wearscope.closed_loop.selection.significance import find_memory, flip_scores, score_chance
from wearscope.effects.base import Effect

#: Length of the filter, of the shortest run, and at most so many rows.
_LENGTH, _LONGEST = 0.125, 80
#: Ridge of the filter, of the residual's power, so that it does not lift what the common filter has cut off.
_FLOOR = 1e-3
#: Sine of the angle to the filtered model below which a drift's levels absorb a term.
_ABSORBED = 1e-3


def drift_p_value(
    assembly: Assembly, chosen: Chosen, joint: int, flips: np.ndarray, always: bool = False
) -> float:
    """p-value of a term conditional on a drift of what it leaves at a joint, with that made white.

    Parameters
    ----------
    assembly : Assembly
    chosen : Chosen
        What would be added to the model.
    joint : int
        One at which it is felt.
    flips : ndarray (F, B)
        Random signs of the blocks.
    always : bool
        Whether it is made white even where what is left is not seen to be autocorrelated beyond a block.

    Returns
    -------
    float
        0 where what is left is not autocorrelated beyond a block; 1 where a drift's levels absorb the term.
    """
    layout = assembly.layout
    keep = layout.keep[:, joint]
    own = chosen.rows[chosen.candidate.joints.index(joint)]
    # About the model as all joints fit it: what they know of its coefficients holds there, not at zero.
    model, y = assembly.columns[joint], assembly.residual[:, joint]
    # A generic term takes a drift into itself: what is left then would say nothing of one.
    both = model if chosen.candidate.effect.empirical else np.concatenate([model, own], axis=1)
    elsewhere = assembly.know_elsewhere(joint)
    x = both * keep[:, None]
    gram = x.T @ x
    gram += np.diag(1e-10 * np.diag(gram) + 1e-300)
    k = model.shape[1]
    gram[:k, :k] += elsewhere * assembly.sigma[joint] ** 2
    left = y - both @ np.linalg.solve(gram, x.T @ y)
    sums = layout.sum_blocks(np.where(keep, left, 0.0))
    if not always and find_memory(sums, layout.run_of) <= 1:
        return 0.0
    kept = layout.unpack(keep)
    runs = [bridge_uncounted(r[:, None], k)[:, 0] for r, k in zip(layout.unpack(left), kept, strict=True)]
    length = int(min(_LENGTH * min(len(r) for r in runs), _LONGEST))
    if length < 2:
        return 1.0
    whiten = find_filter(runs, length)
    levels = np.zeros((len(y), len(runs)))
    for r, (start, stop) in enumerate(pairwise(np.cumsum([0, *(len(run) for run in runs)]))):
        levels[start:stop, r] = 1.0
    every = layout.unpack(np.concatenate([model, levels, own, y[:, None]], axis=1))
    bridged = [bridge_uncounted(part, k) for part, k in zip(every, kept, strict=True)]
    filtered = np.concatenate([signal.lfilter(whiten, 1.0, part, axis=0) for part in bridged])
    settled = np.concatenate([np.arange(len(r)) >= length for r in runs])
    filtered *= (keep & settled)[:, None]
    p = model.shape[1] + len(runs)
    a, c, target = filtered[:, :p], filtered[:, p:-1], filtered[:, -1]
    # What is known of the model's coefficients, by other joints too, stays known; that of the levels is not.
    known = np.zeros((p, p))
    known[:k, :k] = elsewhere * np.mean(target[keep & settled] ** 2)
    rest = take_out(a, known, np.column_stack([c, target]))
    clean, residual = rest[:, :-1], rest[:, -1]
    inner = clean.T @ clean
    if np.trace(inner) < _ABSORBED**2 * np.sum(c**2):
        return 1.0
    inner += 1e-9 * np.diag(np.diag(inner)) + 1e-300 * np.eye(len(inner))
    scores = layout.sum_blocks(clean * residual[:, None])
    observed, chance = flip_scores(scores[:, None, :], inner[None], flips)
    return float(stats.norm.sf(score_chance(observed, chance)))


def take_out(columns: np.ndarray, known: np.ndarray, x: np.ndarray) -> np.ndarray:
    """What a model's columns leave of others, its coefficients held by what is known of them.

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


def does_drift_explain(
    problem: Problem, policy: Policy, flips: np.ndarray, assembly: Assembly, e: Evidence, tried: int
) -> bool:
    """Whether a drift of what a term leaves explains it as well.

    Parameters
    ----------
    problem : Problem
    policy : Policy
    flips : ndarray (F, B)
        Random signs of the blocks.
    assembly : Assembly
        The model.
    e : Evidence
        Of the term.
    tried : int
        Models, conditional on which the same was asked.
    """
    effect, joints = e.term.effect, int(problem.prepared.moving.sum())
    by_run = problem.layout.folds.by_run
    if rule.relieves(e, policy):
        return False
    if not effect.empirical and _is_beyond_drift(problem, policy, assembly, e):
        return False
    level = policy.unknown_level if effect.empirical else policy.family_level
    kinds = count_kinds(problem, effect, e.joint)
    # What imitates a drift in a single run leaves none to be seen.
    imitates = not (by_run or effect.empirical or effect.is_level)
    p_value = drift_p_value(assembly, e.chosen, e.joint, flips, always=imitates)
    return tried * kinds * joints * p_value > level


def count_kinds(problem: Problem, effect: Effect, joint: int) -> int:
    """How many are asked of its kind: shapes of the generic term, what every drive has, or all names."""
    if effect.empirical:
        return len(effect.shapes(problem.joined, joint))
    if effect.is_in_every_drive:
        return sum(other.is_in_every_drive for other in problem.effects)
    return len(problem.effects)


def _is_beyond_drift(problem: Problem, policy: Policy, assembly: Assembly, e: Evidence) -> bool:
    """Whether a term is beyond chance, in a single run given an offset too.

    All parts of a run agree on the level of a drift that is as slow as the run is long.
    """
    by_run = problem.layout.folds.by_run
    beyond = rule.is_beyond_chance(e, policy, by_run)
    if by_run or not beyond:
        return beyond
    if e.term.effect.is_offset:
        return False
    here = {c.candidate.joint for c in assembly.chosen if c.candidate.effect.is_offset}
    offsets = [k for k in problem.effects if k.is_offset]
    made = [problem.candidate(k, j) for k in offsets for j in e.chosen.candidate.joints if j not in here]
    every = (*assembly.chosen, *(Chosen(k, (0,)) for k in made if k is not None))
    given = Assembly(assembly.layout, assembly.target, every, assembly.sigma)
    own = weigh(given, e.chosen.candidate, e.chosen.subset, policy)
    return rule.is_beyond_chance(own, policy, by_run)
