"""Names that represent what a joint's motion has been: no term has a memory of that kind."""

from wearscope.closed_loop.model.candidates import Candidate
from wearscope.closed_loop.model.regression import penalise
from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.evidence import Evidence, Found, Refusal, on_same_folds, weigh
from wearscope.closed_loop.selection.motion_dependence import Dependence, list_past
from wearscope.closed_loop.selection.search import Search
from wearscope.effects.unknown import LEVELS
from wearscope.effects.vocabulary import empirical_effect

#: Hat functions: a line's too, which alone carries over to runs whose joint turns round at other places.
_LEVELS = (2, LEVELS[0])
#: Of names of the position alone: finer ones, with a short memory, are any friction law.
_FINE_LEVELS = (*_LEVELS, *LEVELS[1:3])


def doubt_for_past(search: Search, found: list[Found]) -> tuple[list[Found], dict[int, Dependence]]:
    """The terms found without names that a spline of the past leaves nothing to do; what their joints have.

    The position has much of that at which its joint last turned round. A name is dropped where such a spline
    explains more, held out and fitted, clearly or so that much of the rest depends on it, and given it the
    name would not be taken: what its joint depends on takes its place.
    """
    depends: dict[int, Dependence] = {}
    for f in list(found):
        if f.effect.standard or f.effect.empirical:
            continue
        others = [k for k in found if k is not f]
        given = search.assemble(others)
        own = search.weigh_again(given, f)
        best = _find_past(search, given, own)
        if best is None:
            continue
        depends_on, past = best
        _, (own, past) = on_same_folds(given, [own, past], search.policy)
        if past.gain <= own.gain or past.fitted <= own.fitted:
            continue
        rest = weigh(search.assemble(found), past.chosen.candidate, past.chosen.subset, search.policy)
        if not (rule.separates(past, own, search.policy) or rest.share >= search.policy.structure_share):
            continue
        again = search.weigh_again(search.assemble([*others, Found(past.chosen, past)]), f)
        if search.judge(again) is Refusal.NONE:
            continue
        search.progress(f"{own.term.label} is dropped: what the motion has been explains more")
        depends[own.joint] = Dependence(min(past.share, 1.0), depends_on, past=True)
        found = others
    return found, depends


def _find_past(search: Search, given: Assembly, own: Evidence) -> tuple[list[str], Evidence] | None:
    """Signals and evidence of the best spline of a joint's past among those that fit better than a name."""
    joint, effect = own.joint, empirical_effect()
    best: tuple[list[str], Evidence] | None = None
    least = float(given.add(given.sum_products(own.chosen.candidate).select(own.chosen.subset)).gain[0])
    levels = _FINE_LEVELS if set(own.term.effect.depends_on) == {"q_{joint}"} else _LEVELS
    for codes, columns in list_past(search.problem.train, joint, levels):
        penalty = penalise(columns) / given.sigma[joint] ** 2
        candidate = Candidate(effect, joint, ((),), (joint,), [columns], penalty)
        if float(given.add(given.sum_products(candidate)).gain[0]) <= least:
            continue
        e = weigh(given, candidate, tuple(range(candidate.count)), search.policy)
        if best is None or e.gain > best[1].gain:
            best = [f"{code}_{search.problem.prepared.dataset.joints[joint]}" for code in codes], e
    return best
