"""The revision: each term of a model asked again given all others, and what follows when one goes."""

from collections.abc import Callable, Collection, Iterable, Sequence

from wearscope.closed_loop.model.candidates import Candidate
from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.evidence import Evidence, Found, Refusal, on_same_folds, weigh
from wearscope.closed_loop.selection.search import NEAR, Search

#: What is said of a term that stays unless another one is better.
_KEEPING = (Refusal.NONE, Refusal.CHANCE, Refusal.DISAGREES)
#: Share of the gain asked for that a term must reach on its fitted rows to be weighed. It saves time.
_HOPELESS = 0.4


def revise(search: Search, found: list[Found]) -> list[Found]:
    """Test each term again, with all others in the model: whether it is needed and the best.

    Where a term at its joint was dropped or replaced, it must pass as new: it may have followed that one's
    form.
    """
    changed: set[int] = set()
    for f in sorted(found, key=lambda f: (not _represents_weight(f, found), f.evidence.gain)):
        if not any(k is f for k in found):
            continue
        others = absorb(search, f, [k for k in found if k is not f])
        given = search.assemble(others, f.effect.standard)
        if f.effect.standard:
            own = weigh(given, f.chosen.candidate, f.chosen.subset, search.policy)
            stays = is_refined(search, f, others) and _is_believable(search, own)
            stays = stays or is_needed(search, given, own) or is_much(search, f.chosen, others)
            if not stays and not is_accepted(search, f, others):
                search.progress(f"{own.term.label} is dropped: not needed with the others")
                found = others
                continue
            if f.effect.is_in_every_drive:
                found = [Found(k.chosen, own) if k is f else k for k in found]
                continue
            given = search.assemble(others)
        named = (Refusal.NONE,) if f.joint in changed else _KEEPING
        keeping = tuple(Refusal) if f.effect.standard else named
        again = ask_again(search, given, others, f, keeping)
        if again is None:
            search.progress(f"{f.evidence.term.label} is dropped: not needed with the others")
            found = others
            changed.add(f.joint)
        else:
            if again.effect is not f.effect:
                changed.add(f.joint)
                search.progress(f"{f.evidence.term.label} is replaced by {again.evidence.term.label}")
            found = [again if k is f else k for k in found]
    return found


def _represents_weight(f: Found, found: Sequence[Found]) -> bool:
    """Whether a term is an offset, as a weight on a slide is before a body of the whole robot is named.

    It is asked before that body: conditional on it another one, with more parameters, would do as well.
    """
    optional = f.effect.standard and not f.effect.is_in_every_drive
    return optional and any(k.effect.per_robot for k in found)


def is_much(search: Search, chosen: Chosen, others: Sequence[Found]) -> bool:
    """Whether plain friction explains much conditional on the others, with the form of its reversal held.

    Errors of that form have most of what weak viscous friction adds to Coulomb friction. They are of no
    machine, and every machine has such friction; what they leave of another reversal is less.
    """
    if not chosen.candidate.effect.is_plain_friction:
        return False
    given = search.assemble(others, standard=True, held=True)
    own = weigh(given, chosen.candidate, chosen.subset, search.policy)
    return rule.is_plain(own, search.policy) and is_needed(search, given, own)


def is_accepted(search: Search, f: Found, others: Sequence[Found]) -> bool:
    """Whether a standard term would be taken again conditional on the others, as any name is."""
    given = search.assemble(others)
    own = search.weigh_again(given, f)
    return search.judge(own) is Refusal.NONE and not search.drifts(given, own)


def is_refined(search: Search, f: Found, others: Sequence[Found]) -> bool:
    """Whether a term at the same joint refines this one, and nothing else there that stays.

    Plain friction, which every joint has, stays with whatever refines it.
    """
    here = [k.effect for k in others if k.joint == f.joint]
    present = [*search.problem.declared, *search.problem.given, *here]
    if f.effect.is_plain_friction:
        return any(f.effect.name in k.parents for k in here)
    return any(not k.has_parent(present) for k in here)


def absorb(search: Search, f: Found, others: list[Found]) -> list[Found]:
    """The other terms, with one that contains a standard term in the form in which it has its part too.

    A spring's or balancer's torque at rest is no offset of the torque next to it.
    """
    whole = find_whole(f, others)
    if whole is None or not f.effect.standard:
        return others
    rest = [k for k in others if k is not whole]
    again = ask_again(search, search.assemble(rest), rest, whole)
    if again is None or again.effect is not whole.effect:
        return others
    return [again if k is whole else k for k in others]


def ask_again(
    search: Search, given: Assembly, others: list[Found], f: Found, keeping: Collection[Refusal] = _KEEPING
) -> Found | None:
    """A term again conditional on all others: itself, what is better, or None.

    Parameters
    ----------
    given : Assembly
        Of the others.
    others : list of Found
    f : Found
    keeping : collection of Refusal
        What may be said of it where it stays.
    """
    own = search.weigh_again(given, f)
    joints = f.chosen.candidate.joints if f.effect.spread else (f.joint,)
    offered = search.list_rivals(given, others, joints)
    refused = search.judge(own)
    keeps = refused in keeping and search.is_delay(given, own, settled=True)
    least = match_gain(given, own) if keeps else find_least(search, given)
    weighed = search.weigh_all(given, offered, least)
    able = [e for e in weighed if e.refusal is Refusal.NONE]
    if keeps:
        given, (own, *able) = on_same_folds(given, [own, *able], search.policy)
        near = [e for e in able if e.gain > NEAR * own.gain and rule.gains_there(e, own)]
        near = [search.refine(given, e) for e in near if search.is_delay(given, e)]
        chosen = rule.choose([own, *near], search.policy)
        if chosen is None or chosen is own:
            return Found(f.chosen, own)
        # A drift that explains both says nothing of which one it is; an offset is the level of one.
        if chosen.term.effect is not f.effect and (
            (chosen.complexity >= own.complexity and not rule.separates(chosen, own, search.policy))
            or (search.drifts(given, chosen) and not (f.effect.is_offset or search.drifts(given, own)))
        ):
            return Found(f.chosen, own)
        return Found(chosen.chosen, chosen)
    best = search.choose(given, able)
    return None if best is None else Found(best.chosen, best)


def drop_superfluous(search: Search, found: list[Found], joints: set[int], kept: set[int]) -> list[Found]:
    """Drop terms at joints that are not needed conditional on new ones; some are kept (identities).

    A name is needed on the rows that are fitted too: what it gains on held-out ones alone is the penalty of a
    spline that it takes the place of.
    """
    for f in sorted(found, key=lambda f: f.evidence.gain):
        if f.joint not in joints or id(f.chosen) in kept or f.effect.is_plain_friction:
            continue
        others = [k for k in found if k is not f]
        given = search.assemble(others, f.effect.standard)
        own = search.weigh_again(given, f)
        if f.effect.standard:
            needed = is_needed(search, given, own)
        elif f.effect.empirical:
            needed = own.share >= search.policy.structure_share
        else:
            needed = search.judge(own) is Refusal.NONE and own.fitted >= search.policy.material_share
        if not needed:
            search.progress(f"{own.term.label} is dropped: not needed with unknown structure")
            found = others
    return found


def restore_standard(search: Search, found: list[Found], joints: Collection[int]) -> list[Found]:
    """The terms found, with standard ones of joints that were dropped while what hid them had no term yet.

    They are asked as they were at first, and come before what is built on them or represents them.
    """
    for joint in sorted(joints):
        given = search.assemble(found, standard=True)
        for candidate in search.candidates(given, found, [joint], lambda effect, _: effect.standard):
            subset = tuple(int(k) for k in candidate.effect.subsets()[0])
            own = weigh(given, candidate, subset, search.policy)
            if is_needed(search, given, own) or is_much(search, own.chosen, found):
                search.progress(f"{own.term.label}: needed in addition to what was found")
                found = [*found, Found(own.chosen, own)]
                given = search.assemble(found, standard=True)
    return found


def find_whole(f: Found, others: Iterable[Found]) -> Found | None:
    """The term among others at the same joint that contains one."""
    return next((k for k in others if k.joint == f.joint and f.effect.name in k.effect.contains), None)


def match_gain(assembly: Assembly, own: Evidence) -> Callable[[Candidate], float]:
    """Reduction of the loss below which a candidate cannot stand in the place of a term.

    Both on the rows that they are fitted on: what is held out of a few runs can lie far beyond the others.
    """
    sums = assembly.sum_products(own.chosen.candidate).select(own.chosen.subset)
    least = _HOPELESS * float(assembly.add(sums).gain.max())
    return lambda _: least


def find_least(search: Search, assembly: Assembly) -> Callable[[Candidate], float]:
    """Reduction of the loss below which a candidate cannot be material conditional on a model."""
    losses, policy = assembly.sample_losses, search.policy
    standard, named = _HOPELESS * policy.material_whole, _HOPELESS * policy.material_share
    return lambda c: (standard if c.effect.standard else named) * float(losses[list(c.joints)].min())


def _is_believable(search: Search, e: Evidence) -> bool:
    """Whether a standard term's coefficients are within what such machines have."""
    low_high = zip(e.beta, search.problem.bounds(e.term), strict=True)
    return all(low <= b <= high for b, (low, high) in low_high)


def is_needed(search: Search, given: Assembly, e: Evidence, drifting: bool = False) -> bool:
    """Whether a standard term is kept, by the rule, and no drift of what it leaves explains it.

    Where it may be `drifting`, a drift that explains it does not matter. Plain friction that explains much is
    there, whatever else is missing yet and looks like a drift.
    """
    after_standard = bool(search.standard_losses.any())
    if after_standard and not e.term.effect.is_in_every_drive:
        (e,) = search.compare_whole(given, [e])
    return (
        _is_believable(search, e)
        and rule.is_needed(e, search.policy, search.problem.layout.folds.by_run)
        and (drifting or rule.is_plain(e, search.policy) or not search.drifts(given, e))
    )
