"""Whether a drift of what a term leaves explains it as well, asked of what is about to be taken."""

import numpy as np

from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.evidence import Evidence, weigh
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.problem import Problem
from wearscope.closed_loop.selection.whitening import drift_p_value
from wearscope.effects.base import Effect


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
        Models beside which the same was asked.
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
    """Whether a term is beyond chance, in a single run beside an offset too.

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
    beside = Assembly(assembly.layout, assembly.target, every, assembly.sigma)
    own = weigh(beside, e.chosen.candidate, e.chosen.subset, policy)
    return rule.is_beyond_chance(own, policy, by_run)
