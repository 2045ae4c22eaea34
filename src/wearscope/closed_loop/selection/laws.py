"""Friction laws beside the reversal that suits each: a law's low end and a wide reversal look alike.

Widths are fitted beside a model that lacks a law yet. One that rises smoothly from rest then makes the
reversal wide, and another law is named for what that leaves. So a law that was named is compared with the
others once more, each with the width that fits best beside it.
"""

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from wearscope.closed_loop.model.candidates import make_candidate
from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.evidence import Refusal
from wearscope.closed_loop.selection.found import Found
from wearscope.closed_loop.selection.law_fit import fit_law
from wearscope.closed_loop.selection.reversal import is_wide
from wearscope.closed_loop.selection.search import Search
from wearscope.effects.base import Effect

#: Signals of a law.
_OWN_SPEED = {"qd_{joint}", "sign_qd_{joint}"}


def suit_laws(search: Search, found: list[Found]) -> list[Found]:
    """The terms found, each law replaced where another one, with a reversal of its own, leaves less.

    Or where it leaves as little, and the law that was named needs a reversal that is too wide for one. Where
    none was named one is asked for, if the reversal is too wide or a law would explain much.

    Parameters
    ----------
    search : Search
        Which goes on along the reversals of those that replace one.
    found : list of Found
    """
    prepared, model = search.problem.prepared, search.assemble(found)
    smooth = np.flatnonzero(prepared.moving & (prepared.reversals.width > 0.0)).tolist()
    laws = [(f.effect.name, f.joint) for f in found if is_law(f.effect) and f.joint in smooth]
    named = {joint for _, joint in laws}
    laws += [("", j) for j in smooth if j not in named and _asks_for_law(search, model, j)]
    for name, joint in laws:
        # Terms are made anew along other reversals.
        f = next((f for f in found if (f.effect.name, f.joint) == (name, joint)), None)
        found = _suit(search, found, joint, f)
    return found


def is_law(effect: Effect) -> bool:
    """Whether an effect is a law of its joint's own speed that not every drive has."""
    return not effect.standard and not effect.empirical and set(effect.depends_on) <= _OWN_SPEED


def _asks_for_law(search: Search, model: Assembly, joint: int) -> bool:
    """Whether a joint's reversal is too wide for one, or a law would remove much of what is left."""
    candidates = [search.problem.candidate(e, joint) for e in search.problem.effects if is_law(e)]
    gains = [float(model.add(model.sum_products(c)).gain.max()) for c in candidates if c is not None]
    much = search.policy.material_apart * float(model.sample_losses[joint])
    return is_wide(search.problem.prepared, joint) or max(gains, default=0.0) >= much


def _suit(search: Search, found: list[Found], joint: int, f: Found | None) -> list[Found]:
    problem = search.problem
    others = [k for k in found if k is not f]
    model = search.assemble(found)
    best = _Suited(search, found, model)
    offered = search.candidates(search.assemble(others), others, [joint])
    for effect in (c.effect for c in offered if is_law(c.effect)):
        own = None if f is None else f.chosen
        fitted = fit_law(problem.prepared, model, joint, own, effect, effect.shapes(problem.joined, joint))
        if fitted is None:
            continue
        shape, reversals = fitted
        tried = copy(search)
        rest = tried.reverse_over(reversals, others)
        beside = tried.assemble(rest)
        made = make_candidate(effect, joint, tried.problem.prepared, shape[None])
        asked = len(problem.effects) * int(problem.prepared.moving.sum())
        weighed = tried.weigh_all(beside, [replace(made, tried=float(asked))])
        able = [Found(e.chosen, e) for e in weighed if e.refusal is Refusal.NONE]
        if not able:
            continue
        law = max(able, key=lambda law: law.evidence.gain)
        other = _Suited(tried, [*rest, law], tried.assemble([*rest, law]))
        same = f is not None and effect is f.effect and best.search is search
        if other.suits_better(best, joint, same) and not tried.drifts(beside, law.evidence):
            best = other
    if best.search is not search:
        label = best.found[-1].evidence.term.label
        search.progress(f"{label}: with a reversal of its own it leaves less than what was there")
        search.adopt(best.search)
    return best.found


@dataclass(frozen=True)
class _Suited:
    """A search along some reversals, what it found, and the model with that."""

    search: Search
    found: list[Found]
    model: Assembly

    def suits_better(self, other: "_Suited", joint: int, same: bool) -> bool:
        """Whether clearly less is left at a joint, or with a reversal that is one, not clearly more.

        Of the same law it need not be outside noise: that is its best fit.
        """
        policy = self.search.policy
        mine, its = self.model.fitted_losses[:, joint], other.model.fitted_losses[:, joint]
        gain, error = rule.summed(its - mine)
        material = policy.material_apart * float(mine.sum())
        clear = material if same else max(policy.told_apart * error, material)
        wide = [is_wide(one.search.problem.prepared, joint) for one in (self, other)]
        likelier = wide == [False, True] and len(self.found) == len(other.found)
        return gain > (-clear if likelier else clear)
