"""A joint's laws of friction, fitted with its reversal: a law's low end and a wide reversal look alike.

The rough model's width is that of a poorer model. With the terms that the search has found, the width is
fitted again and its form is chosen. A law that rises smoothly from rest makes the reversal wide where the
model lacks it, and another law would be named for what that leaves. So each law is compared with the width
that fits best with it. All of these fits are one: variable projection (Golub and Pereyra 1973).
"""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from scipy import optimize

from wearscope.closed_loop.inference.gram import Fit
from wearscope.closed_loop.inference.reversal import REVERSAL, WIDEST, find_top
from wearscope.closed_loop.inference.term import Term
from wearscope.closed_loop.intake.direction import FORMS, Reversals
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.intake.rough_model import fit_bounded
from wearscope.closed_loop.intake.threads import map_runs
from wearscope.closed_loop.model.terms import reduce_columns
from wearscope.effects.base import Effect, MeasurementEffect, RigidBodyEffect

#: Signals of a law.
_OWN_SPEED = {"qd_{joint}", "sign_qd_{joint}"}
#: Least and largest width, and those that a fit may start from, over the joint's largest speed.
_LEAST, _LARGEST, _STARTS = 1e-4, 0.3, (0.001, 0.004, 0.015, 0.05)
#: Residual variances by which another start or form must do better; share of the loss that a width must
#: remove where the rough model found an instant reversal.
_CLEARLY, _AT_ONCE = 9.0, 0.2
#: A law that starts with more than this multiple of the present law's sum of squares is not fitted further.
_HOPELESS = 4.0
#: Largest number of steps of a fit, and the share of the sum of squares below which a step ends it.
_STEPS, _NEAR = 12, 1e-3


def is_law(effect: Effect) -> bool:
    """Whether an effect is a law of its joint's own speed that not every drive has."""
    return not effect.standard and not effect.empirical and set(effect.depends_on) <= _OWN_SPEED


def refine_reversals(prepared: Prepared, model: Fit, forms: bool = True) -> Reversals:
    """How each joint's friction reverses where a model fits the training runs best.

    The width is fitted in the present form first, then in the others.

    Parameters
    ----------
    prepared : Prepared
    model : Fit
        The model.
    forms : bool
        Whether other forms are tried: one can pass for what the model lacks yet.

    Returns
    -------
    Reversals
        Unchanged where nothing in the model changes its sign with the motion; a reversal at once stays one
        unless a width does clearly better, and a form stays unless another one does.
    """
    best = prepared.reversals
    for joint in np.flatnonzero(prepared.moving).tolist():
        fit = _JointFit(prepared, model, joint)
        if not fit.own:
            continue
        found, least = fit.refine(prepared.reversals)
        first = found
        for step in range(1, len(FORMS) if forms and first.width[joint] > 0.0 else 1):
            other, loss = fit.refine(first.change_form(step), starts=())
            if loss < least - fit.clearly(least):
                found, least = other, loss
        best = found.where(fit.only, best)
    return best


def fit_law(
    prepared: Prepared, model: Fit, joint: int, own: Term | None, effect: Effect,
    shapes: np.ndarray,
) -> tuple[np.ndarray, Reversals] | None:  # fmt: skip
    """Shape of a friction law in the place of a term, and the reversal that fits best with it.

    The fit starts from the best of the shapes and of some widths. It stays within the range of the shapes'
    positive numbers and below the largest width that drives have.

    Parameters
    ----------
    prepared : Prepared
    model : Fit
    joint : int
    own : Term or None
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
    present = _square(_JointFit(prepared, model, joint).leave(prepared.reversals)[0])
    fit = _JointFit(prepared, model, joint, effect, own)
    tried = [
        (_square(e), fit.widen(share), s)
        for share in _STARTS
        for s, e in enumerate(fit.leave(fit.widen(share), shapes))
    ]
    least, start, s = min(tried, key=lambda one: one[0])
    if least > _HOPELESS * present:
        return None
    low, high = shapes.min(axis=0), shapes.max(axis=0)
    free = {k: (low[k], high[k]) for k in np.flatnonzero((high > low) & (low > 0.0)).tolist()}
    reversals, shape, _ = fit.descend(start, WIDEST, shapes[s], free)
    return shape, reversals


class _JointFit:
    """Least squares of a joint's torque on its own terms along a reversal of any width and form.

    The terms felt at other joints and the errors of the recording stay fixed.

    Parameters
    ----------
    prepared : Prepared
    model : Fit
    joint : int
    law : Effect, optional
        Fitted with the joint's terms; no coefficient is then below its bound.
    instead : Term, optional
        The joint's term in whose place the law stands.
    """

    def __init__(
        self,
        prepared: Prepared,
        model: Fit,
        joint: int,
        law: Effect | None = None,
        instead: Term | None = None,
    ) -> None:
        self.prepared, self.joint, self.law = prepared, joint, law
        self.only, self.top = np.arange(prepared.n) == joint, float(find_top(prepared)[joint])
        mine = [k for k, term in enumerate(model.terms) if _is_own(term, joint)]
        # The reversal's error is left out: the width and form that are fitted take its place.
        ends = [k for k, term in enumerate(model.terms) if _is_reversal(term, joint)]
        fitted = [c for k in (*mine, *ends) for c in range(model.spans[k].start, model.spans[k].stop)]
        held = np.isin(model.at[joint], fitted, invert=True)
        theta = model.theta[model.at[joint][held]]
        self.keep = model.gram.layout.keep[:, joint]
        self.target = (model.gram.target[:, joint] - model.columns(joint)[:, held] @ theta)[self.keep]
        replaced = None if instead is None else instead.candidate
        self.own = [model.terms[k] for k in mine if model.terms[k].candidate is not replaced]
        coefficients = [t.candidate.effect.coefficients[c] for t in self.own for c in t.subset]
        self.low = np.full(len(coefficients), -np.inf)
        if law is not None:
            self.low = np.array([p.lower for p in (*coefficients, *law.coefficients)])

    def widen(self, share: float) -> Reversals:
        """The present reversals with another width at the joint, over its largest speed."""
        today = self.prepared.reversals
        return Reversals(np.where(self.only, share * self.top, today.width), today.form)

    def clearly(self, loss: float) -> float:
        """What another start or form must gain."""
        return _CLEARLY * loss / max(len(self.target), 1)

    def leave(self, reversals: Reversals, shapes: np.ndarray | None = None) -> list[np.ndarray]:
        """Torque (K,) that is left along reversals, with each shape of the law."""
        now = not reversals.differ(self.prepared.reversals).any()
        runs = self.prepared.runs_for("train") if now else self.prepared.try_reversals(reversals, self.joint)
        kept = [self._reduce(term, runs)[self.keep] for term in self.own]
        if self.law is None or shapes is None:
            return [_leave(np.column_stack(kept), self.target, self.low)]
        law = np.concatenate(map_runs(partial(reduce_columns, self.law, self.joint, shapes), runs))
        each = np.split(law[self.keep], len(shapes), axis=1)
        return [_leave(np.column_stack([*kept, x]), self.target, self.low) for x in each]

    def _reduce(self, term: Term, runs: list) -> np.ndarray:
        """Columns (M, m) of a term along runs in which only the joint's direction of motion has changed."""
        if not term.follows_direction:
            return term.at_joint(self.joint)
        shape = np.array(term.model_term.shape)[None]
        parts = map_runs(partial(reduce_columns, term.candidate.effect, self.joint, shape), runs)
        return np.concatenate(parts)[:, list(term.subset)]

    def refine(self, present: Reversals, starts: Sequence[float] = _STARTS) -> tuple[Reversals, float]:
        """The width that fits best in the present form, from the present width or a better start."""
        least = _square(self.leave(present)[0])
        wide = present.width[self.joint] > 0.0
        needed = least - self.clearly(least) if wide else (1.0 - _AT_ONCE) * least
        tried = [(_square(self.leave(self.widen(share))[0]), self.widen(share)) for share in starts]
        loss, start = min(tried, key=lambda one: one[0], default=(least, present))
        if loss >= needed:
            loss, start = least, present
        if not start.width[self.joint] > 0.0:
            return start, loss
        found, _, after = self.descend(start, _LARGEST)
        return (found, after) if after < loss else (start, loss)

    def descend(
        self, start: Reversals, widest: float, shape: np.ndarray | None = None,
        free: Mapping[int, tuple[float, float]] | None = None,
    ) -> tuple[Reversals, np.ndarray, float]:  # fmt: skip
        """Width, and free numbers of the law's shape within their bounds, that fit best; and their loss."""
        law = np.zeros(0) if shape is None else np.array(shape, dtype=float)
        bounds = dict(free or {})

        def make(z: np.ndarray) -> Reversals:
            law[list(bounds)] = np.exp(z[1:])
            return Reversals(np.where(self.only, np.exp(z[0]), start.width), start.form)

        low, high = np.log([(_LEAST * self.top, widest * self.top), *bounds.values()]).T
        first = np.log([start.width[self.joint], *law[list(bounds)]])
        found = optimize.least_squares(
            lambda z: self.leave(make(z), law[None])[0], np.clip(first, low + 1e-3, high - 1e-3),
            bounds=(low, high), max_nfev=_STEPS, ftol=_NEAR,
        )  # fmt: skip
        return make(found.x), law, 2.0 * float(found.cost)


def _is_reversal(term: Term, joint: int) -> bool:
    """Whether a term is the error of a joint's reversal."""
    return term.candidate.effect is REVERSAL and term.candidate.joint == joint


def _is_own(term: Term, joint: int) -> bool:
    """Whether a term acts at one joint alone and is evaluated along its motion."""
    effect = term.candidate.effect
    fixed = effect.spread or isinstance(effect, MeasurementEffect | RigidBodyEffect)
    return term.candidate.joint == joint and effect is not REVERSAL and not fixed


def _square(x: np.ndarray) -> float:
    return float(x @ x)


def _leave(x: np.ndarray, y: np.ndarray, low: np.ndarray) -> np.ndarray:
    """Residual of columns whose coefficients have lower bounds."""
    return np.asarray(y - x @ fit_bounded(x, y, low, np.full(x.shape[1], np.inf))[1])
