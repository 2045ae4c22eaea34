"""Two terms of which each hides the other: asked for together where no single one can be taken."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.evidence import Evidence, Found, Refusal
from wearscope.closed_loop.selection.revision import find_least
from wearscope.closed_loop.selection.search import NEAR, Search

#: What may be said of a term that another one hides: of a size that matters, but that looks like chance, of
#: which runs disagree, or (with nothing said yet) that looks like a drift.
_HIDDEN = (Refusal.NONE, Refusal.CHANCE, Refusal.DISAGREES)
#: Most exchanges of one term of a pair for a better one conditional on the other.
_EXCHANGES = 3


def find_pair(search: Search, found: Sequence[Found], weighed: Sequence[Evidence]) -> list[Evidence]:
    """Two terms at a joint that pass the rule conditional on each other, where neither does alone.

    What one of two large effects leaves is the other one, next to which it looks like chance, like what runs
    disagree on, or like a drift: whichever is asked first is refused. Both are taken where each passes all of
    the rule conditional on the other and is the best there. p-values count how many first terms were tried.

    Parameters
    ----------
    search : Search
    found : sequence of Found
        The model's terms.
    weighed : sequence of Evidence
        On what was asked in addition to it, none of which was taken.

    Returns
    -------
    list of Evidence
        The two, or nothing; of several pairs of a joint the one that gains most.
    """
    assembly = search.assemble(found)
    hidden = [e for e in weighed if _is_hidden(search, e) and search.is_delay(assembly, e)]
    for joint in sorted({e.joint for e in hidden}):
        firsts = _list_firsts([e for e in hidden if e.joint == joint])
        pairs = [_complete(search, found, assembly, e, len(firsts)) for e in firsts]
        pairs = [pair for pair in pairs if pair]
        if pairs:
            return max(pairs, key=lambda pair: _gain(assembly, pair))
    return []


def _is_hidden(search: Search, e: Evidence) -> bool:
    """Whether another term may hide one: where the joint's larger terms are left out of what it must gain."""
    return search.judge(replace(e, whole=np.inf, refusal=Refusal.NONE)) in _HIDDEN


def _list_firsts(able: Sequence[Evidence]) -> list[Evidence]:
    """The best form of each effect at a joint that gains nearly as much as the best one."""
    best: dict[str, Evidence] = {}
    for e in sorted(able, key=lambda e: -e.gain):
        best.setdefault(e.term.effect.name, e)
    most = max(e.gain for e in best.values())
    return [e for e in best.values() if e.gain > NEAR * most]


def _complete(
    search: Search, found: Sequence[Found], assembly: Assembly, first: Evidence, tried: int
) -> list[Evidence]:
    """A term and another one, each the best given the other, reached from a first one; or nothing."""
    first = search.refine(assembly, first)
    second = _find_given(search, found, assembly, first, tried)
    for _ in range(_EXCHANGES):
        if second is None:
            break
        again = _find_given(search, found, assembly, second, tried)
        if again is not None and again.term.effect is first.term.effect:
            return [again, second]
        first, second = second, again
    return []


def _find_given(
    search: Search, found: Sequence[Found], assembly: Assembly, e: Evidence, tried: int
) -> Evidence | None:
    """The best other term at a term's joints that passes the rule conditional on it."""
    given = _add(assembly, [e])
    joints = e.chosen.candidate.joints
    offered = search.candidates(given, [*found, Found(e.chosen, e)], joints)
    weighed = search.weigh_all(
        given, [c for c in offered if set(c.joints) & set(joints)], find_least(search, given)
    )
    counted = [replace(e, p_value=min(1.0, tried * e.p_value)) for e in weighed]
    able = [e for e in counted if e.refusal is Refusal.NONE and search.judge(e) is Refusal.NONE]
    return search.choose(given, able, tried)


def _add(assembly: Assembly, terms: Sequence[Evidence]) -> Assembly:
    every = (*assembly.chosen, *(e.chosen for e in terms))
    return Assembly(assembly.layout, assembly.target, every, assembly.sigma)


def _gain(assembly: Assembly, terms: Sequence[Evidence]) -> float:
    """Reduction of the held-out loss by terms together."""
    return float(np.nansum(assembly.joint_losses) - np.nansum(_add(assembly, terms).joint_losses))
