"""Terms of which held-out runs cannot say anything, asked on fifths of the runs.

Beside a term that is there, what a run needs may be undetermined by the others, as where each of a few has a
motion of its own: the model then runs away on the run that is held out, with the term and not without it,
whose place other parameters took. A term that removes nearly all that the model leaves on the rows that are
fitted is therefore asked again with fifths of every run held out, where nothing else is taken.
"""

from collections.abc import Sequence
from dataclasses import replace

from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.evidence import Evidence, Refusal, weigh
from wearscope.closed_loop.selection.search import Search


def weigh_by_fifths(search: Search, assembly: Assembly, weighed: Sequence[Evidence]) -> list[Evidence]:
    """Evidence, by fifths, on those terms that held-out runs refuse and that may be accepted so.

    Parameters
    ----------
    search : Search
    assembly : Assembly
        The model.
    weighed : sequence of Evidence
        On what was asked beside it, none of which was taken.

    Returns
    -------
    list of Evidence
        What passes the rule as of a single run and removes nearly all in each of the fifths that inform.
    """
    if not search.problem.layout.folds.by_run:
        return []
    able = []
    for e in weighed:
        if not rule.explains_fit(e, search.policy):
            continue
        own = weigh(assembly, e.chosen.candidate, e.chosen.subset, search.policy, by_fifths=True)
        (own,) = search.compare_whole(assembly, [replace(own, p_value=e.p_value, tried=e.tried)])
        sure = rule.is_beyond_chance(own, search.policy, by_run=False)
        if sure and search.judge(own) is Refusal.NONE:
            able.append(own)
    return able
