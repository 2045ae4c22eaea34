"""From a problem to its names: the search, what has no name, sets of names, and the same in other bands."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wearscope.closed_loop.intake.thinning import prepare_thinned
from wearscope.closed_loop.selection.bands import Named, find_standing, is_doubtful, keep_agreed
from wearscope.closed_loop.selection.evidence import Evidence
from wearscope.closed_loop.selection.found import Found
from wearscope.closed_loop.selection.generic import GenericTerms, explain_rest
from wearscope.closed_loop.selection.hum import find_hum
from wearscope.closed_loop.selection.motion_dependence import Dependence, find_dependence
from wearscope.closed_loop.selection.naming import name_terms
from wearscope.closed_loop.selection.problem import Problem
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.unbelievable import find_unbelievable
from wearscope.errors import InputError


@dataclass(frozen=True)
class Answer:
    """What a search ends with.

    Attributes
    ----------
    found : list of Found
    equivalent : list of list of str
        Names beside each.
    left : dict of int to Evidence
        By joint, the best generic structure that was found and could not be added, or a name that would
        explain what is left and has parameters that no such machine has.
    dependence : dict of int to Dependence
        By other joints, what of the residual depends on the motion.
    notes : list of str
        On a hum, and on names that stand at some common cut-offs alone.
    """

    found: list[Found]
    equivalent: list[list[str]]
    left: dict[int, Evidence]
    dependence: dict[int, Dependence]
    notes: list[str]


def pose_again(problem: Problem, widened: float) -> Problem:
    """The same problem at another common cut-off, `widened` times the chosen one."""
    prepared = prepare_thinned(problem.prepared.dataset, widened=widened)
    return Problem(prepared, problem.declared, problem.own)


def find_terms(search: Search, pose: Callable[[Problem, float], Problem] = pose_again) -> Answer:
    """Terms that a search's declared model lacks, with names, from the training runs.

    Where a name is doubtful, all is asked again in other bands (`selection/bands.py`).

    Parameters
    ----------
    search : Search
    pose : callable
        ``pose(problem, widened)`` gives the problem at another common cut-off.
    """
    chosen = search.problem
    notes: list[str] = []
    own = find_names(search)
    found = own.found
    if search.policy.octaves and any(is_doubtful(f, search.policy) for f in found):
        own, notes = keep_agreed(search, own, find_names_elsewhere(search, own, chosen, pose))
        found = search.settle_reversals(own.found) if notes else found
    moving = search.problem.prepared.moving
    asked = [j for j in range(search.problem.prepared.n) if moving[j] and j not in own.left]
    left = own.left | find_unbelievable(search, found, asked)
    dependence = find_dependence(search, found, asked) | search.past
    hum = search.problem.hum
    told = [] if hum is None else hum.describe(search.problem.prepared.dataset.joints)
    return Answer(found, own.equivalent, left, dependence, [*told, *notes])


def find_names(search: Search) -> Named:
    """Names in a search's band, which starts anew without the hum that what it finds first leaves."""
    found, left = _find_all(search)
    hum = find_hum(search.problem, search.assemble(found), search.policy)
    if hum is not None:
        search.progress("a hum is left: all is asked again without it")
        search.start_over(search.problem.take_out(hum))
        found, left = _find_all(search)
    found, equivalent = name_terms(search, found)
    found = search.settle_reversals(found)
    return Named(found, equivalent, left, search.problem.prepared.band.torque)


def _find_all(search: Search) -> tuple[list[Found], dict[int, Evidence]]:
    """Terms that the declared model lacks, generic ones among them, and structure that cannot be added."""
    return explain_rest(search, GenericTerms(search.problem.prepared, search.problem.joined), search.run())


def find_names_elsewhere(
    search: Search, own: Named, chosen: Problem, pose: Callable[[Problem, float], Problem]
) -> list[Named]:
    """Names at a lower and a higher common cut-off than the chosen one, each as if it were that.

    Where the motion is not known so far up, the other one is lower still; one that the runs are too short for
    is left out.

    Parameters
    ----------
    search : Search
        Whose rule and progress they share.
    own : Named
        Which of its names stand there is asked too.
    chosen : Problem
    pose : callable
    """
    others = []
    factor = 2.0**search.policy.octaves
    for widened in (1.0 / factor, factor):
        try:
            problem = pose(chosen, widened)
            if widened > 1.0 and problem.prepared.band.torque < own.cutoff * np.sqrt(factor):
                problem = pose(chosen, factor**-2)
        except InputError as error:
            search.progress(str(error))
            continue

        def tell(line: str, hz: float = problem.prepared.band.torque) -> None:
            search.progress(f"at {hz:.3g} Hz: {line}")

        elsewhere = Search(problem, search.policy, tell)
        named = find_names(elsewhere)
        others.append(replace(named, standing=find_standing(elsewhere, own, named.found)))
    return others
