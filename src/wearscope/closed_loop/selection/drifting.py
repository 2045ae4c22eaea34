"""Whether a drift of what a term leaves explains it as well, asked of what is about to be taken."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly, Chosen
from wearscope.closed_loop.selection.evidence import Evidence, weigh
from wearscope.closed_loop.selection.whitening import drift_p_value
from wearscope.effects.base import Effect

if TYPE_CHECKING:
    from wearscope.closed_loop.selection.search import Search


def does_drift_explain(search: "Search", assembly: Assembly, e: Evidence, tried: int) -> bool:
    """Whether a drift of what a term leaves explains it as well; `tried` models were asked beside."""
    effect, joints = e.term.effect, int(search.problem.prepared.moving.sum())
    by_run = search.problem.layout.folds.by_run
    if rule.relieves(e, search.policy):
        return False
    if not effect.empirical and _is_beyond_drift(search, assembly, e):
        return False
    level = search.policy.unknown_level if effect.empirical else search.policy.family_level
    kinds = count_kinds(search, effect, e.joint)
    # What imitates a drift in a single run leaves none to be seen.
    imitates = not (by_run or effect.empirical or effect.is_level)
    p_value = drift_p_value(assembly, e.chosen, e.joint, search.flips, always=imitates)
    return tried * kinds * joints * p_value > level


def is_drift(
    search: "Search", assembly: Assembly, e: Evidence, able: Sequence[Evidence], tried: int = 1
) -> bool:
    """Whether a drift explains a term, or one among others that it contains and is not told from."""
    inside = [o for o in able if o.term.effect.name in e.term.effect.contains and rule.touches(o, e)]
    tied = [o for o in inside if not rule.separates(e, o, search.policy)]
    return any(search.drifts(assembly, one, tried) for one in (*tied, e))


def count_kinds(search: "Search", effect: Effect, joint: int) -> int:
    """How many are asked of its kind: shapes of the generic term, what every drive has, or all names."""
    if effect.empirical:
        return len(effect.shapes(search.problem.joined, joint))
    if effect.is_in_every_drive:
        return sum(other.is_in_every_drive for other in search.problem.effects)
    return len(search.problem.effects)


def _is_beyond_drift(search: "Search", assembly: Assembly, e: Evidence) -> bool:
    """Whether a term is beyond chance, in a single run beside an offset too.

    All parts of a run agree on the level of a drift that is as slow as the run is long.
    """
    by_run = search.problem.layout.folds.by_run
    beyond = rule.is_beyond_chance(e, search.policy, by_run)
    if by_run or not beyond:
        return beyond
    if e.term.effect.is_offset:
        return False
    here = {c.candidate.joint for c in assembly.chosen if c.candidate.effect.is_offset}
    offsets = [k for k in search.problem.effects if k.is_offset]
    made = [
        search.problem.candidate(k, j) for k in offsets for j in e.chosen.candidate.joints if j not in here
    ]
    every = (*assembly.chosen, *(Chosen(k, (0,)) for k in made if k is not None))
    beside = Assembly(assembly.layout, assembly.target, every, assembly.sigma)
    own = weigh(beside, e.chosen.candidate, e.chosen.subset, search.policy)
    return rule.is_beyond_chance(own, search.policy, by_run)
