"""From a problem to its names: the search, what has no name, sets of names, and what is left."""

from dataclasses import dataclass

from wearscope.closed_loop.selection.evidence import Evidence
from wearscope.closed_loop.selection.found import Found
from wearscope.closed_loop.selection.generic import GenericTerms, explain_rest
from wearscope.closed_loop.selection.hum import find_hum
from wearscope.closed_loop.selection.laws import suit_laws
from wearscope.closed_loop.selection.motion_dependence import Dependence, find_dependence
from wearscope.closed_loop.selection.naming import name_terms
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.single_joints import prefer_single_joints
from wearscope.closed_loop.selection.standard import find_standard
from wearscope.closed_loop.selection.stepwise import extend, settle
from wearscope.closed_loop.selection.unbelievable import find_unbelievable


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
    notes : list of str
        On a hum.
    """

    found: list[Found]
    equivalent: list[list[str]]
    left: dict[int, Evidence]
    dependence: dict[int, Dependence]
    notes: list[str]


def find_terms(search: Search) -> Answer:
    """Terms that a search's declared model lacks, with names, from the training runs.

    The search starts again without the hum that its first terms leave.
    """
    found, left, depends = _find_all(search)
    hum = find_hum(search.problem, search.assemble(found), search.policy)
    if hum is not None:
        search.progress("a hum is left: the search starts again without it")
        search.start_over(search.problem.take_out(hum))
        found, left, depends = _find_all(search)
    found, equivalent = name_terms(search, found)
    found = search.settle_reversals(found)
    prepared = search.problem.prepared
    asked = [j for j in range(prepared.n) if prepared.moving[j] and j not in left]
    left = left | find_unbelievable(search, found, asked)
    dependence = find_dependence(search, found, asked) | depends
    hum = search.problem.hum
    notes = [] if hum is None else hum.describe(prepared.dataset.joints)
    return Answer(found, equivalent, left, dependence, notes)


def find_named(search: Search) -> list[Found]:
    """Terms with a name that the declared model lacks: the standard ones of each joint, then all others."""
    found = search.settle_reversals(find_standard(search), forms=False)
    search.keep_standard(found)
    found = settle(search, search.settle_reversals(extend(search, found)))
    found = prefer_single_joints(search, found)
    suited = suit_laws(search, found)
    return found if suited is found else settle(search, search.settle_reversals(suited))


def _find_all(search: Search) -> tuple[list[Found], dict[int, Evidence], dict[int, Dependence]]:
    """Terms that the declared model lacks, generic ones among them, and structure that cannot be added."""
    terms = GenericTerms(search.problem.prepared, search.problem.joined)
    return explain_rest(search, terms, find_named(search))
