"""The continuous shape of a term: from the grid's best value to the one that fits the torque best."""

from dataclasses import replace

import numpy as np
from scipy import optimize

from wearscope.closed_loop.model.candidates import Candidate, make_candidate
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.evidence import Evidence, weigh
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.problem import Problem


def refine(problem: Problem, assembly: Assembly, e: Evidence, policy: Policy) -> Evidence:
    """The same term at its best continuous shape, its significance kept.

    Parameters
    ----------
    problem : Problem
    assembly : Assembly
        The model, conditional on which it was weighed.
    e : Evidence
    policy : Policy
    """
    effect, candidate = e.term.effect, e.chosen.candidate
    if effect.search is None or effect.name_driver is not None:
        return e
    grid = effect.shapes(problem.joined, candidate.joint)
    first = effect.estimated_shapes()
    # The estimated one again once the others have moved.
    others = [k for k in map(int, np.flatnonzero(np.ptp(grid, axis=0) > 0)) if k not in first]
    order = [*first[:1], *others, *(first[:1] if others else [])]
    shape = np.array(candidate.shapes[0])
    # In the logarithm, so that what can be nothing or negative stays as it is.
    for k in (k for k in order if grid[:, k].min() > 0.0 and shape[k] > 0.0):
        shape[k] = _refine_one(problem, assembly, e, shape, k, grid[:, k])
    finer = weigh(assembly, _shape(problem, e, shape), e.chosen.subset, policy)
    if finer.gain <= e.gain:
        return e
    return replace(finer, p_value=e.p_value, tried=e.tried, refusal=e.refusal, whole=e.whole)


def _shape(problem: Problem, e: Evidence, shape: np.ndarray) -> Candidate:
    return make_candidate(e.term.effect, e.term.joint, problem.prepared, shape[None])


def _refine_one(
    problem: Problem, assembly: Assembly, e: Evidence, shape: np.ndarray, k: int, grid: np.ndarray
) -> float:
    """Best value of one shape parameter, the others held; within its grid (S,) if not estimated."""
    effect = e.term.effect
    low, high = np.log(grid.min() / shape[k]), np.log(grid.max() / shape[k])
    if k in effect.estimated_shapes():
        width = effect.width(problem.joined, e.term.joint, shape.tolist())
        low = max(-width, float(np.log(max(effect.shape[k].lower, 1e-12) / shape[k])))
        high = min(width, float(np.log(min(effect.shape[k].upper, 1e12) / shape[k])))

    def loss(x: float) -> float:
        tried = shape.copy()
        tried[k] *= np.exp(x)
        sums = assembly.sum_products(_shape(problem, e, tried)).select(e.chosen.subset)
        return -float(assembly.add(sums).gain[0])

    found = optimize.minimize_scalar(
        loss, bounds=(low, high), method="bounded", options={"maxiter": 10, "xatol": 1e-3 * (high - low)},
    )  # fmt: skip
    return float(shape[k] * np.exp(found.x)) if found.fun < loss(0.0) else float(shape[k])
