"""Friction laws with the reversal that suits each: a law's low end and a wide reversal look alike.

The width of a reversal is a shape of its joint's law of friction. Fitted with a model that lacks a law, one
that rises smoothly from rest makes the reversal wide, and another law would be named for what that leaves. So
each law is offered with the width that fits best with it.
"""

from functools import partial

import numpy as np
from scipy import optimize

from wearscope.closed_loop.inference.gram import Fit
from wearscope.closed_loop.inference.reversal import (
    DIFFERENCE,
    LEAST,
    STARTS,
    WIDEST,
    find_top,
    list_own,
    reduce_term,
    take_rest,
)
from wearscope.closed_loop.inference.term import Term
from wearscope.closed_loop.intake.direction import Reversals
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.intake.rough_model import fit_bounded
from wearscope.closed_loop.intake.threads import map_runs
from wearscope.closed_loop.model.terms import reduce_columns
from wearscope.effects.base import Effect

#: Signals of a law.
_OWN_SPEED = {"qd_{joint}", "sign_qd_{joint}"}


def is_law(effect: Effect) -> bool:
    """Whether an effect is a law of its joint's own speed that not every drive has."""
    return not effect.standard and not effect.empirical and set(effect.depends_on) <= _OWN_SPEED


#: A law that starts with more than this multiple of the present law's sum of squares is not fitted further.
_HOPELESS = 4.0
#: Largest number of steps of the fit; the fit ends with a step that gains less than this share of the sum of
#: squares.
_STEPS, _NEAR = 12, 1e-3


def fit_law(
    prepared: Prepared, model: Fit, joint: int, own: Term | None, effect: Effect,
    shapes: np.ndarray,
) -> tuple[np.ndarray, Reversals] | None:  # fmt: skip
    """Shape of a friction law in the place of a term, and the reversal that fits best with it.

    The fit starts from the best of the shapes and of some widths. It stays within the range of the shapes'
    positive numbers and below the largest width that drives have (variable projection, Golub and Pereyra
    1973).

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
    fit = _LawFit(prepared, model, joint, own, effect)
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

    def __init__(self, prepared: Prepared, model: Fit, joint: int, own: Term | None, effect: Effect) -> None:
        self.prepared, self.effect, self.joint = prepared, effect, joint
        mine = list_own(model.terms, self.joint)
        self.target, self.keep = take_rest(model, self.joint, mine)
        replaced = None if own is None else own.candidate
        self.kept = [model.terms[k] for k in mine if model.terms[k].candidate is not replaced]
        self.only = np.arange(prepared.n) == self.joint
        bounded = [c.candidate.effect.coefficients[k] for c in self.kept for k in c.subset]
        self.low = np.array([p.lower for p in (*bounded, *effect.coefficients)])
        every = [model.terms[k].at_joint(joint)[self.keep] for k in mine]
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
    """Residual of columns whose coefficients have lower bounds."""
    return np.asarray(y - x @ fit_bounded(x, y, low, np.full(x.shape[1], np.inf))[1])
