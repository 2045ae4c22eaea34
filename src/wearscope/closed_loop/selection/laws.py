"""Friction laws with the reversal that suits each: a law's low end and a wide reversal look alike.

Widths are fitted with a model that lacks a law yet. One that rises smoothly from rest then makes the
reversal wide, and another law is named for what that leaves. So a law that was named is compared with the
others once more, each with the width that fits best with it.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import optimize

from wearscope.closed_loop.intake.direction import Reversals
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.intake.rough_model import fit_bounded
from wearscope.closed_loop.intake.threads import map_runs
from wearscope.closed_loop.model.candidates import make_candidate, reduce_columns
from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.evidence import Found, Refusal
from wearscope.closed_loop.selection.reversal import (
    DIFFERENCE,
    LEAST,
    STARTS,
    WIDEST,
    find_top,
    is_wide,
    list_own,
    reduce_term,
    take_rest,
)
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
        tried = search.branch()
        rest = tried.reverse_over(reversals, others)
        given = tried.assemble(rest)
        made = make_candidate(effect, joint, tried.problem.prepared, shape[None])
        asked = len(problem.effects) * int(problem.prepared.moving.sum())
        weighed = tried.weigh_all(given, [replace(made, tried=float(asked))])
        able = [Found(e.chosen, e) for e in weighed if e.refusal is Refusal.NONE]
        if not able:
            continue
        law = max(able, key=lambda law: law.evidence.gain)
        other = _Suited(tried, [*rest, law], tried.assemble([*rest, law]))
        same = f is not None and effect is f.effect and best.search is search
        if other.suits_better(best, joint, same) and not tried.drifts(given, law.evidence):
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


#: Sum of squares, of what the present law leaves, from which another one at its start is not fitted further.
_HOPELESS = 4.0
#: Most steps of the fit; share of the sum of squares below which a step is the last.
_STEPS, _NEAR = 12, 1e-3


def fit_law(
    prepared: Prepared, assembly: Assembly, joint: int, own: Chosen | None, effect: Effect,
    shapes: np.ndarray,
) -> tuple[np.ndarray, Reversals] | None:  # fmt: skip
    """Shape of a law of a joint's speed, in the place of a term, and the reversal that fits best with it.

    From the best of the shapes and of some widths on, within the range of the shapes' positive numbers and up
    to a width that drives have (variable projection, Golub and Pereyra 1973).

    Parameters
    ----------
    prepared : Prepared
    assembly : Assembly
        The model.
    joint : int
    own : Chosen or None
        The term of it in whose place the law stands, if it does.
    effect : Effect
        The law.
    shapes : ndarray (S, k)
        Of it.

    Returns
    -------
    (ndarray (k,), Reversals) or None
        Nothing where it is far from what the model leaves, wherever it starts.
    """
    fit = _LawFit(prepared, assembly, joint, own, effect)
    today = prepared.reversals
    top = float(find_top(prepared)[joint])
    widths = [share * top for share in STARTS]
    tried = [(float(e @ e), width, s) for width in widths for s, e in enumerate(fit.leave(width, shapes))]
    least, width, s = min(tried)
    if least > _HOPELESS * fit.present:
        return None
    free = np.flatnonzero((np.ptp(shapes, axis=0) > 0.0) & (shapes.min(axis=0) > 0.0))
    shape = np.array(shapes[s], dtype=float)

    def leave(z: np.ndarray) -> np.ndarray:
        shape[free] = np.exp(z[1:])
        return fit.leave(float(np.exp(z[0])), shape[None])[0]

    low = np.log([LEAST * top, *shapes[:, free].min(axis=0)])
    high = np.log([WIDEST * top, *shapes[:, free].max(axis=0)])
    start = np.clip(np.log([width, *shape[free]]), low + 1e-3, high - 1e-3)
    found = optimize.least_squares(
        leave, start, bounds=(low, high), diff_step=DIFFERENCE, max_nfev=_STEPS, ftol=_NEAR
    )
    shape[free] = np.exp(found.x[1:])
    return shape, Reversals(np.where(fit.only, np.exp(found.x[0]), today.width), today.form)


class _LawFit:
    """Least squares of a joint's torque on its own plain terms and a law, with a reversal of any width."""

    def __init__(
        self, prepared: Prepared, assembly: Assembly, joint: int, own: Chosen | None, effect: Effect
    ) -> None:
        self.prepared, self.effect, self.joint = prepared, effect, joint
        mine = list_own(assembly.chosen, self.joint)
        self.target, self.keep = take_rest(assembly, self.joint, mine)
        replaced = None if own is None else own.candidate
        self.kept = [assembly.chosen[k] for k in mine if assembly.chosen[k].candidate is not replaced]
        self.only = np.arange(prepared.n) == self.joint
        bounded = [c.candidate.effect.coefficients[k] for c in self.kept for k in c.subset]
        self.low = np.array([p.lower for p in (*bounded, *effect.coefficients)])
        every = [assembly.chosen[k].rows[0][self.keep] for k in mine]
        unbounded = np.full(sum(x.shape[1] for x in every), -np.inf)
        left = _leave_bounded(np.column_stack(every), self.target, unbounded)
        self.present = float(left @ left)

    def leave(self, width: float, shapes: np.ndarray) -> list[np.ndarray]:
        """Torque (K,) that is left with each shape, no coefficient below its bound."""
        today = self.prepared.reversals
        changed = Reversals(np.where(self.only, width, today.width), today.form)
        runs = self.prepared.try_reversals(changed, self.joint)
        kept = [reduce_term(c, runs)[self.keep] for c in self.kept]
        law = np.concatenate(map_runs(partial(reduce_columns, self.effect, self.joint, shapes), runs))
        each = np.split(law[self.keep], len(shapes), axis=1)
        return [_leave_bounded(np.column_stack([*kept, x]), self.target, self.low) for x in each]


def _leave_bounded(x: np.ndarray, y: np.ndarray, low: np.ndarray) -> np.ndarray:
    """What columns leave whose coefficients are not below bounds."""
    return np.asarray(y - x @ fit_bounded(x, y, low, np.full(x.shape[1], np.inf))[1])
