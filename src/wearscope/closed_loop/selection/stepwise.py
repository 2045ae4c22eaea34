"""Forward selection and revision, in turn, until nothing changes.

1. Forward: given the model, every candidate at every joint; the one that gains most on held-out runs and is
   accepted by the rule is added, in its simplest form that is as good; until none is accepted, and no two
   of a joint together.
2. Revision: each term again conditional on all others: kept, replaced or dropped.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen, find_reach
from wearscope.closed_loop.selection.evidence import Evidence, Found, Refusal, count_parameters, weigh
from wearscope.closed_loop.selection.pairs import find_pair
from wearscope.closed_loop.selection.problem import Problem
from wearscope.closed_loop.selection.revision import find_least, is_needed, restore_standard, revise
from wearscope.closed_loop.selection.search import Search

#: Most passes of the revision.
_PASSES = 3


def settle(search: Search, found: list[Found]) -> list[Found]:
    """Test each term again, and look for more, until nothing changes.

    What is taken only in the weights of a model without it, and not conditional on all others in those of the
    whole model, is not needed.
    """
    for _ in range(_PASSES):
        asked_again = revise(search, found)
        grown = extend(search, asked_again)
        if _names(grown) == _names(found):
            return asked_again if _names(asked_again) < _names(found) else grown
        found = grown
    return found


def extend(search: Search, found: list[Found], most: float = np.inf) -> list[Found]:
    """Add terms until none is accepted: at each step the best of every joint, where they do not touch.

    Or until all together have as many parameters as `most`.
    """
    while count_parameters(found) < most:
        search.sigma = search.scale(found)
        search.refused.clear()
        assembly = search.assemble(found)
        offered = search.candidates(assembly, found, range(search.problem.prepared.n))
        # All are weighed once, for the table; later only what may be accepted.
        first = search._step <= 1
        weighed = search.weigh_all(assembly, offered, *([] if first else [find_least(search, assembly)]))
        taken = take(search, assembly, weighed) or find_pair(search, found, weighed)
        search.record(weighed, taken)
        if not taken:
            return found
        for e in taken:
            search.progress(f"{e.term.label}: {100 * e.share:.0f} % of the joint's held-out loss")
        found = [*found, *(Found(e.chosen, e) for e in taken)]
        # What was missing yet may have hidden what a plain joint has, which comes before what refines it.
        touched = {j for e in taken for j in e.chosen.candidate.joints}
        found = restore_standard(search, found, touched)
    return found


def take(search: Search, assembly: Assembly, weighed: list[Evidence]) -> list[Evidence]:
    """Terms to add at one step, no two of which are felt at a joint that the model couples."""
    able = [e for e in weighed if e.refusal is Refusal.NONE]
    taken: list[Evidence] = []
    coupled = any(len(c.candidate.joints) > 1 for c in assembly.chosen)
    while able:
        best = search.choose(assembly, able)
        if best is None:
            break
        taken.append(best)
        if coupled:
            break
        apart = [e for e in able if not rule.touches(e, best)]
        # What is felt at several joints may explain what is next better than what is felt at one.
        wide = max((e.gain for e in able if len(e.chosen.candidate.joints) > 1), default=0.0)
        able = [e for e in apart if e.gain > wide]
    return taken


def _names(found: Iterable[Found]) -> set[tuple[str, int, tuple[int, ...]]]:
    return {(f.effect.name, f.joint, f.chosen.subset) for f in found}


def find_standard(search: Search) -> list[Found]:
    """Standard terms that held-out runs need, of each joint as a group.

    What is missing yet can hide friction that is there, or pose as its opposite: it stays until the
    revision asks for it conditional on all that was found.
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
            given = Assembly(problem.layout.for_standard, problem.target, every, search.sigma, reach)
            e = weigh(given, chosen.candidate, chosen.subset, search.policy)
            evidence[id(chosen)] = e
            if (
                not chosen.candidate.effect.is_plain_friction
                and not is_needed(search, given, e)
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
