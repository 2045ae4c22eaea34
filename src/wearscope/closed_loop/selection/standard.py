"""The standard stage: what a plain joint may be expected to have, asked of each joint as a group."""

from collections.abc import Sequence

import numpy as np

from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen, find_reach
from wearscope.closed_loop.selection.evidence import Evidence, weigh
from wearscope.closed_loop.selection.found import Found
from wearscope.closed_loop.selection.problem import Problem
from wearscope.closed_loop.selection.search import Search


def find_standard(search: Search) -> list[Found]:
    """Standard terms that held-out runs need, of each joint as a group.

    What is missing yet can hide friction that is there, or pose as its opposite: it stays until the
    revision asks for it beside all that was found.
    """
    problem = search.problem
    base = search.assemble(())
    joints = range(problem.prepared.n)
    offered = search.candidates(base, (), joints, lambda effect, _: effect.standard)
    kept = [Chosen(c, tuple(int(k) for k in c.effect.subsets()[0])) for c in offered]
    worst: dict[int, tuple[float, Chosen]] = {}
    evidence: dict[int, Evidence] = {}
    while kept:
        search.sigma = _scale_of(problem, kept, search.sigma)
        worst, evidence = {}, {}
        for chosen in kept:
            others = tuple(k for k in kept if k is not chosen)
            every = (*problem.base, *others)
            reach = find_reach(every, chosen.candidate)
            beside = Assembly(problem.layout.for_standard, problem.target, every, search.sigma, reach)
            e = weigh(beside, chosen.candidate, chosen.subset, search.policy)
            evidence[id(chosen)] = e
            if (
                not chosen.candidate.effect.is_plain_friction
                and not search.is_needed(beside, e)
                and e.share < worst.get(e.joint, (np.inf, chosen))[0]
            ):
                worst[e.joint] = (e.share, chosen)
        if not worst:
            break
        gone = [chosen for _, chosen in worst.values()]
        kept = [k for k in kept if not any(k is g for g in gone)]
    search.record([evidence[id(k)] for k in kept], [evidence[id(k)] for k in kept])
    for k in kept:
        search.progress(f"standard term {evidence[id(k)].term.label}")
    return [Found(k, evidence[id(k)]) for k in kept]


def _scale_of(problem: Problem, chosen: Sequence[Chosen], sigma: np.ndarray) -> np.ndarray:
    """Residual scale (n,) of the declared model with these terms, from the scale before on."""
    return Assembly(problem.layout, problem.target, (*problem.base, *chosen), sigma).settle_scale()
