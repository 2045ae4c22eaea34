"""From a problem to its names: the search, what has no name, sets of names, and what is left."""

from collections.abc import Iterable
from dataclasses import dataclass

from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.evidence import Evidence, Found
from wearscope.closed_loop.selection.generic import GenericTerms, explain_rest
from wearscope.closed_loop.selection.laws import suit_laws
from wearscope.closed_loop.selection.levels import take_levels
from wearscope.closed_loop.selection.motion_dependence import Dependence, find_dependence
from wearscope.closed_loop.selection.naming import name_terms
from wearscope.closed_loop.selection.revision import find_least
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.single_joints import prefer_single_joints
from wearscope.closed_loop.selection.stepwise import extend, find_standard, settle


@dataclass(frozen=True)
class Answer:
    """What a search ends with.

    Attributes
    ----------
    found : list of Found
    equivalent : list of list of str
        Other names in the confidence set of each.
    left : dict of int to Evidence
        By joint, the best generic structure that was found and could not be added, or a name that would
        explain what is left and has parameters that no such machine has.
    dependence : dict of int to Dependence
        By other joints, what of the residual depends on the motion.
    suspected : dict of int to list of Evidence
        By joint, names that explain much of what is left, most first, and are too uncertain to be taken.
    """

    found: list[Found]
    equivalent: list[list[str]]
    left: dict[int, Evidence]
    dependence: dict[int, Dependence]
    suspected: dict[int, list[Evidence]]


def find_terms(search: Search) -> Answer:
    """Terms that a search's declared model lacks, with names, from the training runs."""
    terms = GenericTerms(search.problem.prepared, search.problem.joined)
    found = find_named(search)
    if take_levels(search, found):
        found = find_named(search)
    found, left, depends = explain_rest(search, terms, found)
    found, equivalent = name_terms(search, found)
    found = search.settle_reversals(found)
    prepared = search.problem.prepared
    asked = [j for j in range(prepared.n) if prepared.moving[j] and j not in left]
    unbelievable, suspected = ask_rest(search, found, asked)
    left = left | unbelievable
    return Answer(found, equivalent, left, find_dependence(search, found, asked) | depends, suspected)


def find_named(search: Search) -> list[Found]:
    """Terms with a name that the declared model lacks: the standard ones of each joint, then all others."""
    found = search.settle_reversals(find_standard(search), forms=False)
    search.sigma = search.scale(found)
    search.standard_losses = search.assemble(found).joint_sums
    found = settle(search, search.settle_reversals(extend(search, found)))
    found = prefer_single_joints(search, found)
    suited = suit_laws(search, found)
    return found if suited is found else settle(search, search.settle_reversals(suited))


def ask_rest(
    search: Search, found: list[Found], joints: Iterable[int]
) -> tuple[dict[int, Evidence], dict[int, list[Evidence]]]:
    """By joint, the names that explain most of what is left: unbelievable ones, and suspected ones.

    What is refused for its parameters alone is there, whatever it is: it makes the joint `unexplained`. What
    is refused for its significance alone may be there.

    Parameters
    ----------
    search : Search
    found : list of Found
        All that was named.
    joints : iterable of int
        Those that are asked.
    """
    search.sigma = search.scale(found)
    assembly = search.assemble(found)
    offered = search.candidates(assembly, found, joints, every=True)
    by_run = search.problem.layout.folds.by_run
    left: dict[int, Evidence] = {}
    suspected: dict[int, list[Evidence]] = {}
    for e in sorted(search.weigh_all(assembly, offered, find_least(search, assembly)), key=lambda e: -e.gain):
        explains = rule.explains_unbelievably(e, search.policy, by_run)
        if e.joint not in left and explains and not search.drifts(assembly, e):
            left[e.joint] = e
        if rule.is_suspected(e, search.policy, by_run):
            suspected.setdefault(e.joint, []).append(e)
    return left, {j: able for j, able in suspected.items() if j not in left}
