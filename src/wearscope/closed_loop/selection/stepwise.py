"""Forward selection and revision, in turn, until nothing changes.

1. Forward: beside the model, every candidate at every joint; the one that gains most on held-out runs and is
   accepted by the rule is added, in its simplest form that is as good; until none is accepted, and no two
   of a joint together.
2. Revision: each term again beside all others: kept, replaced or dropped.
"""

from collections.abc import Iterable

import numpy as np

from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.evidence import Evidence, Refusal
from wearscope.closed_loop.selection.found import Found, count_parameters
from wearscope.closed_loop.selection.pairs import find_pair
from wearscope.closed_loop.selection.revision import restore_standard, revise
from wearscope.closed_loop.selection.search import Search

#: Most passes of the revision.
_PASSES = 3


def settle(search: Search, found: list[Found]) -> list[Found]:
    """Ask of each term again, and for more, until nothing changes.

    What is taken only in the weights of a model without it, and not beside all others in those of the
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
        assembly = search.assemble(found)
        offered = search.candidates(assembly, found, range(search.problem.prepared.n))
        # All are weighed once, for the table; later only what may be accepted.
        first = search._step <= 1
        weighed = search.weigh_all(assembly, offered, *([] if first else [search.find_least(assembly)]))
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
