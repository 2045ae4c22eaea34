"""Whether a name stands in other bands: all is asked again at a lower and a higher common cut-off.

What noise, filters and reversals leave of a torque differs from band to band, and so do names that stand for
it; what a machine has does not (as in stability selection: Meinshausen and Buehlmann 2010, JRSS B 72(4)).
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from wearscope.closed_loop.selection.evidence import Evidence, Refusal, weigh
from wearscope.closed_loop.selection.found import Found
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.revision import restore_standard

if TYPE_CHECKING:
    from wearscope.closed_loop.selection.search import Search

#: What a term must not be in a band to which others bring it: the runs do not hold it there.
_NOT_HELD = (Refusal.ABSORBED, Refusal.CANCELS, Refusal.BOUNDS, Refusal.SMALL)
#: What may be said of a term in another band where it stands.
_STANDS = (Refusal.NONE, Refusal.CHANCE, Refusal.LOCAL)


@dataclass(frozen=True)
class Name:
    """What a search gave a name.

    Attributes
    ----------
    effect : str
    joint : int or None
        None for what the whole robot has once.
    equivalent : tuple of str
        Other names in its confidence set.
    doubtful : bool
        Whether it must stand in another band.
    generic : bool
        Whether it is the generic term, which is no name.
    slow : bool
        Whether it has no form that fast motion shows: the generic term, or an offset.
    """

    effect: str
    joint: int | None
    equivalent: tuple[str, ...] = ()
    doubtful: bool = False
    generic: bool = False
    slow: bool = False

    def is_near(self, other: "Name") -> bool:
        """Whether both are of one joint, or one of the whole robot."""
        return None in (self.joint, other.joint) or self.joint == other.joint

    def is_same(self, other: "Name") -> bool:
        """Whether both name the same effect of the same joint."""
        return (self.effect, self.joint) == (other.effect, other.joint)


@dataclass(frozen=True)
class Agreed:
    """What bands agree on.

    Attributes
    ----------
    kept : list of int
        Of the own band's names.
    beside : list of list of str
        By kept name, what the other bands name in its place.
    added : list of (int, int)
        Band, and number in it, of names that other bands give and the own one does not.
    beside_added : list of list of str
        By added name, names of the own band in whose place it stands.
    """

    kept: list[int]
    beside: list[list[str]]
    added: list[tuple[int, int]]
    beside_added: list[list[str]]


def agree(
    own: Sequence[Name],
    others: Sequence[Sequence[Name]],
    higher: Sequence[bool],
    standing: Sequence[Collection[int]] = (),
) -> Agreed:
    """The names on which bands agree.

    A doubtful name of the own band stays where a higher one gives it, in which more of its form shows, or one
    that is in a confidence set with it, or where it stands there beside what that gives; an offset or generic
    term, for which noise with a memory may stand, where a lower one does. Where there is no such band, or it
    has a generic term in the place of a name, any other is asked. Else what most bands name there takes its
    place, and the place of a generic term what one of them names; where each other one names something else
    there, a name stays, and they stand beside it; where one names nothing there, it goes. What most bands
    name and the own one does not is added.

    Parameters
    ----------
    own : sequence of Name
        Of the band whose model is the answer.
    others : sequence of sequence of Name
        Of each other band.
    higher : sequence of bool
        Whether the other band is the higher one.
    standing : sequence of collection of int, optional
        By other band, own names that stand beside its names.
    """
    meets = [_match(own, other) for other in others]
    stood = standing or [()] * len(others)
    free = [
        [(band, k) for k in range(len(other)) if k not in met]
        for band, (other, met) in enumerate(zip(others, meets, strict=True))
    ]
    added: list[tuple[int, int]] = []
    for at in (one for band in free for one in band):
        name = others[at[0]][at[1]]
        given = sum(any(name.is_same(others[b][k]) for b, k in band) for band in free)
        if 2 * given > 1 + len(others) and not any(name.is_same(others[b][k]) for b, k in added):
            added.append(at)
    kept: list[int] = []
    beside: list[list[str]] = []
    beside_added: list[list[str]] = [[] for _ in added]
    taking: set[tuple[int, int]] = set()
    for i, name in enumerate(own):
        gives = [i in met.values() or i in there for met, there in zip(meets, stood, strict=True)]
        instead = [[(b, k) for b, k in band if others[b][k].is_near(name)] for band in free]
        nameless = [any(others[b][k].generic for b, k in band) for band in instead]
        asked = [band for band, above in enumerate(higher) if above != name.slow]
        # Structure without a name, in whose place another band has this one, does not speak against it.
        if not asked or (not name.generic and all(nameless[band] for band in asked)):
            asked = list(range(len(others)))
        if not name.doubtful or not asked or any(gives[band] for band in asked):
            kept.append(i)
            beside.append([])
            continue
        near = [at for at in added if others[at[0]][at[1]].is_near(name) and at not in taking]
        if name.generic and not near:
            near = [
                at for band in instead for at in band if not others[at[0]][at[1]].slow and at not in taking
            ]
            added += near[:1]
            beside_added += [[] for _ in near[:1]]
        if near:
            taking.add(near[0])
            beside_added[added.index(near[0])] += _list_effects([name])
        elif all(instead) and not name.generic:
            kept.append(i)
            beside.append(_list_effects([others[b][k] for band in instead for b, k in band]))
    return Agreed(kept, beside, added, beside_added)


def _list_effects(names: Sequence[Name]) -> list[str]:
    """Effects that names are of; the generic term stands beside none."""
    return list(dict.fromkeys(n.effect for n in names if not n.generic))


def _match(own: Sequence[Name], other: Sequence[Name]) -> dict[int, int]:
    """By number of another band's name, that of the own one which it speaks for: the same, or equivalent."""
    met: dict[int, int] = {}
    for k, name in enumerate(other):
        same = next((i for i, n in enumerate(own) if n.is_same(name) and i not in met.values()), None)
        if same is not None:
            met[k] = same
    for k, name in enumerate(other):
        if k in met:
            continue
        for i, n in enumerate(own):
            alike = n.effect in name.equivalent or name.effect in n.equivalent
            if i not in met.values() and n.is_near(name) and alike:
                met[k] = i
                break
    return met


@dataclass(frozen=True)
class Named:
    """What a search in one band ends with.

    Attributes
    ----------
    found : list of Found
    equivalent : list of list of str
        Names beside each.
    left : dict of int to Evidence
        By joint, the best generic structure that was found and could not be added.
    cutoff : float
        The common one [Hz].
    standing : collection of int
        Of another band's terms, the numbers of those that stand in this one beside its own.
    """

    found: list[Found]
    equivalent: list[list[str]]
    left: dict[int, Evidence]
    cutoff: float
    standing: Collection[int] = ()

    def names(self, policy: Policy) -> list[Name]:
        """Its names."""
        return [
            Name(
                f.effect.name,
                None if f.effect.per_robot else f.joint,
                tuple(beside),
                is_doubtful(f, policy),
                f.effect.empirical,
                f.effect.empirical or (f.effect.standard and not f.effect.is_in_every_drive),
            )
            for f, beside in zip(self.found, self.equivalent, strict=True)
        ]


def is_doubtful(f: Found, policy: Policy) -> bool:
    """Whether other bands are asked about a term: not every drive has it, and it removes too little."""
    sure = not f.effect.empirical and f.evidence.share >= policy.beyond_doubt
    return not (f.effect.is_in_every_drive or sure)


def keep_agreed(search: "Search", own: Named, others: Sequence[Named]) -> tuple[Named, list[str]]:
    """What bands agree on, in the own one, and a note on each name that goes or comes.

    A generic term that some other band gives too goes from the model, and its joint stays unexplained.
    Where something went, what every drive has is asked for again, which it may have hidden.

    Parameters
    ----------
    search : Search
        Of the own band.
    own : Named
    others : sequence of Named
    """
    policy, joints = search.policy, search.problem.prepared.dataset.joints
    every = [other.names(policy) for other in others]
    higher = [other.cutoff > own.cutoff for other in others]
    agreed = agree(own.names(policy), every, higher, [other.standing for other in others])
    kept = [own.found[i] for i in agreed.kept]
    equivalent = [
        list(dict.fromkeys([*own.equivalent[i], *beside]))
        for i, beside in zip(agreed.kept, agreed.beside, strict=True)
    ]
    left, notes = dict(own.left), []
    gone: set[int] = set()
    where = ", ".join(f"{other.cutoff:.3g}" for other in others)
    for i, (f, name) in enumerate(zip(own.found, own.names(policy), strict=True)):
        if i in agreed.kept:
            continue
        if _is_only_parent(f, kept):
            kept.append(f)
            equivalent.append(own.equivalent[i])
            continue
        if name.generic and any(name.is_same(n) for names in every for n in names):
            left.setdefault(f.joint, f.evidence)
        gone |= set(f.chosen.candidate.joints)
        notes.append(
            f"{name.effect} at {joints[f.joint]}, named at a common cut-off of {own.cutoff:.3g} Hz, does not "
            f"stand at others ({where} Hz): it does not count."
        )
    for (band, k), instead in zip(agreed.added, agreed.beside_added, strict=True):
        e = _weigh_here(search, kept, others[band].found[k])
        if e is None:
            continue
        kept.append(Found(e.chosen, e))
        equivalent.append(list(dict.fromkeys([*others[band].equivalent[k], *instead])))
        left.pop(e.term.joint, None)
        notes.append(
            f"{e.term.effect.name} at {joints[e.term.joint]}, not named at a common cut-off of "
            f"{own.cutoff:.3g} Hz, stands at others ({where} Hz): it counts."
        )
    hidden = [f for f in restore_standard(search, kept, gone)[len(kept) :] if f.effect.is_in_every_drive]
    kept += hidden
    equivalent += [[] for _ in hidden]
    return (Named(kept, equivalent, left, own.cutoff) if notes else own), notes


def find_standing(search: "Search", own: Named, there: Sequence[Found]) -> frozenset[int]:
    """Numbers of doubtful names of the own band that stand in another one beside what was found there.

    They gain there as the rule asks, chance and the number of blocks apart, which the own band answered.

    Parameters
    ----------
    search : Search
        Of the other band.
    own : Named
    there : sequence of Found
    """
    standing = set()
    for i, f in enumerate(own.found):
        if f.effect.empirical or not is_doubtful(f, search.policy):
            continue
        others = [k for k in there if (k.effect.name, k.joint) != (f.effect.name, f.joint)]
        e = _weigh_here(search, others, f)
        if e is not None and search.judge(search.compare_whole(search.assemble(others), [e])[0]) in _STANDS:
            standing.add(i)
    return frozenset(standing)


def _is_only_parent(f: Found, kept: Sequence[Found]) -> bool:
    """Whether a term that stays refines this one, and nothing else there."""
    here = [k.effect for k in kept if k.joint == f.joint]
    return any(f.effect.name in k.parents and not k.has_parent(here) for k in here)


def _weigh_here(search: "Search", found: list[Found], f: Found) -> Evidence | None:
    """Evidence on another band's term beside the terms of this one; None where the runs do not hold it."""
    beside = search.assemble(found)
    if f.effect.empirical:
        candidates = [search.problem.remake(f.chosen).candidate]
    else:
        joints = (*f.chosen.candidate.joints, f.joint)
        offered = search.candidates(beside, found, sorted(set(joints)), every=True)
        candidates = [c for c in offered if c.effect.name == f.effect.name and c.joint == f.joint]
    weighed = [
        weigh(beside, c, f.chosen.subset, search.policy, by_fifths=f.evidence.by_fifths) for c in candidates
    ]
    able = [replace(e, p_value=f.evidence.p_value) for e in weighed if e.gain > 0.0]
    able = [e if f.effect.empirical else search.refine(beside, e) for e in able]
    able = [e for e in able if f.effect.empirical or search.judge(e) not in _NOT_HELD]
    return max(able, key=lambda e: e.gain, default=None)
