"""Friction's reversal under a model: the speed over which each joint's direction of motion changes.

The rough model's width is that of a poorer model. With the terms that the search has found it is fitted again
and its form is chosen. The remaining error of the width is a column in every model to which candidates are
added. So no name is given for a reversal that is a little sharper or smoother than assumed.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from wearscope.closed_loop.inference.gram import Fit
from wearscope.closed_loop.inference.term import Term
from wearscope.closed_loop.intake.direction import FORMS, Reversals
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.intake.rough_model import fit_rough, rough_columns
from wearscope.closed_loop.intake.threads import map_runs
from wearscope.closed_loop.model.terms import make_candidate, reduce_columns
from wearscope.effects.base import Effect, MeasurementEffect, Parameter, RigidBodyEffect, Signals

#: For the logarithm of a width: step of its derivative; number of steps; largest step; smallest step worth
#: taking.
DIFFERENCE, _STEPS, _FURTHEST, _NEAREST = 0.02, 5, 0.5, 0.003
#: Prior standard deviation of the errors of width and form, as a share of Coulomb friction.
_SHARE = 0.5
#: Least and largest width, over the joint's largest speed.
LEAST, _LARGEST = 1e-4, 0.3
#: Largest width that drives have, over the largest speed: a wider reversal represents a law of the speed.
WIDEST = 0.05
#: Start widths in addition to the rough model's, over the joint's largest speed; residual variances by which
#: one must do better than the rough model's.
STARTS, _CLEARLY = (0.001, 0.004, 0.015, 0.05), 9.0
#: Where the rough model found an instant reversal, a width must remove this share of the loss.
_AT_ONCE = 0.2
#: Standard errors that a change of a width must have.
_ERRORS = 1.0


def _take_reversal(signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
    assert signals.reversal is not None
    return signals.reversal[:, joint]


REVERSAL = Effect(
    name="reversal",
    form="what a reversal of another width or form changes in Coulomb friction",
    coefficients=tuple(Parameter(name, "{torque}") for name in ("wider", "one_form", "other_form")),
    source="first-order error of the width; smooth approximations of sign(v) in common use",
    depends_on=("qd_{joint}",),
    regressors=_take_reversal,
    candidate=False,
)
"""What an error of the reversal's width and form leaves of Coulomb friction; never named."""


def make_reversal(prepared: Prepared, joint: int) -> Term:
    """The error of a joint's reversal as a term of a model, held near zero by the joint's friction."""
    candidate = make_candidate(REVERSAL, joint, prepared, np.zeros((1, 0)))
    precision = np.eye(3) / max(_SHARE * _guess_friction(prepared, joint), 1e-12) ** 2
    return Term(replace(candidate, penalty=precision), (0, 1, 2))


def _guess_friction(prepared: Prepared, joint: int) -> float:
    """Coulomb friction of a joint by the rough model, torque unit."""
    x, y = [], []
    for run in prepared.runs_for("train"):
        s = run.signals
        columns = rough_columns(run.known[:, joint], s.a[:, joint], s.sign[:, joint], s.v[:, joint])
        keep = run.keep[:, joint]
        x.append(run.reduce(columns)[keep])
        y.append(run.measured[keep, joint])
    return abs(float(fit_rough(x, y)[2]))


@dataclass(frozen=True)
class _JointFit:
    """Least squares of one joint's torque on its own terms, and the step of its width that does better."""

    loss: float
    noise: float
    step: float
    error: float


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
    frictions = {j: list_own(model.terms, j) for j in np.flatnonzero(prepared.moving).tolist()}
    frictions = {j: terms for j, terms in frictions.items() if terms}
    if not frictions:
        return prepared.reversals
    fitter = _Fitter(prepared, model, frictions)
    losses, best = fitter.descend(fitter.start())
    wide = [j for j in frictions if best.width[j] > 0.0]
    first = best
    for step in range(1, len(FORMS) if wide and forms else 1):
        found, fitted = fitter.descend(first.change_form(step), wide)
        better = np.zeros(prepared.n, dtype=bool)
        for j, fit in found.items():
            if fit.loss < losses[j].loss - _CLEARLY * losses[j].noise:
                losses[j], better[j] = fit, True
        best = fitted.where(better, best)
    return best


def is_wide(prepared: Prepared, joint: int) -> bool:
    """Whether a joint's reversal is wider than any drive's: then it represents a law of the joint's speed."""
    return float(prepared.reversals.width[joint]) > WIDEST * find_top(prepared)[joint]


@dataclass(frozen=True)
class _Fitter:
    """Fits the reversals of the joints that have terms of their own.

    Attributes
    ----------
    prepared : Prepared
    model : Fit
        The model.
    frictions : dict of int to list of int
        Indices of the model's own terms by joint.
    """

    prepared: Prepared
    model: Fit
    frictions: dict[int, list[int]]

    def start(self) -> Reversals:
        """The present reversals, or those at one of the start widths that fit better."""
        prepared, today = self.prepared, self.prepared.reversals
        widths = today.width.copy()
        top = find_top(self.prepared)
        first = self._fit(today, self.frictions)
        least = {
            j: min(fit.loss - _CLEARLY * fit.noise, fit.loss * (1.0 if widths[j] > 0.0 else 1.0 - _AT_ONCE))
            for j, fit in first.items()
        }
        for share in STARTS:
            tried = np.where(prepared.moving, share * top, widths)
            for j, fit in self._fit(Reversals(tried, today.form), self.frictions).items():
                if fit.loss < least[j]:
                    least[j], widths[j] = fit.loss, tried[j]
        return Reversals(widths, today.form)

    def descend(
        self, start: Reversals, joints: Iterable[int] | None = None
    ) -> tuple[dict[int, "_JointFit"], Reversals]:
        """Widths that fit best in the forms given, by Gauss and Newton's steps, and the fits at them."""
        moving = set(self.frictions if joints is None else joints)
        widths, top = start.width.copy(), find_top(self.prepared)
        best: dict[int, tuple[_JointFit, float]] = {}
        for _ in range(_STEPS + 1):
            if not moving:
                break
            fits = self._fit(Reversals(widths, start.form), {j: self.frictions[j] for j in moving})
            for j, fit in fits.items():
                if j in best and not fit.loss < best[j][0].loss:
                    # Go half way back to the better width.
                    if best[j][1] > 0.0 and abs(np.log(widths[j] / best[j][1])) > 2.0 * _NEAREST:
                        widths[j] = np.sqrt(widths[j] * best[j][1])
                    else:
                        moving.discard(j)
                    continue
                best[j] = (fit, widths[j])
                if abs(fit.step) < max(_NEAREST, _ERRORS * fit.error):
                    moving.discard(j)
                    continue
                changed = widths[j] * np.exp(np.clip(fit.step, -_FURTHEST, _FURTHEST))
                widths[j] = float(np.clip(changed, LEAST * top[j], _LARGEST * top[j]))
        for j, (_, width) in best.items():
            widths[j] = width
        return {j: fit for j, (fit, _) in best.items()}, Reversals(widths, start.form)

    def _fit(self, reversals: Reversals, own: dict[int, list[int]]) -> dict[int, "_JointFit"]:
        """Fits of joints whose own terms are evaluated along reversals."""
        wider = Reversals(reversals.width * np.exp(DIFFERENCE), reversals.form)
        now = reversals is self.prepared.reversals
        runs = self.prepared.runs_for("train") if now else self.prepared.try_reversals(reversals)
        return _fit_joints(runs, self.prepared.try_reversals(wider), self.model, own)


def find_top(prepared: Prepared) -> np.ndarray:
    """Largest speed of each joint (n,) along the training runs."""
    return np.max([np.abs(run.signals.v).max(axis=0) for run in prepared.runs_for("train")], axis=0)


def list_own(terms: tuple[Term, ...], joint: int) -> list[int]:
    """Indices of a model's terms that act at one joint alone and are evaluated along its motion."""
    return [
        k
        for k, c in enumerate(terms)
        if c.candidate.joint == joint
        and c.candidate.effect is not REVERSAL
        and not (
            c.candidate.effect.spread or isinstance(c.candidate.effect, (MeasurementEffect, RigidBodyEffect))
        )
    ]


def take_rest(model: Fit, joint: int, own: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """What a joint's own terms have to explain (K,), at the rows (M,) of bool that count."""
    keep = model.gram.layout.keep[:, joint]
    # Terms felt at several joints and errors of the recording stay fixed; the reversal's column is left out.
    held = np.isin(model.at[joint], _list_columns(model, joint, own), invert=True)
    theta = model.theta[model.at[joint][held]]
    return (model.gram.target[:, joint] - model.columns(joint)[:, held] @ theta)[keep], keep


def _fit_joints(
    runs: list[PreparedRun], moved: list[PreparedRun], model: Fit, own: dict[int, list[int]]
) -> dict[int, _JointFit]:
    """Fit each joint's own terms along runs, and the change of its width, the terms of others held.

    `moved` are the runs with widths that are wider by `DIFFERENCE`.
    """
    fits = {}
    for j, terms in own.items():
        x = np.concatenate([reduce_term(model.terms[k], runs) for k in terms], axis=1)
        other = np.concatenate([reduce_term(model.terms[k], moved) for k in terms], axis=1)
        y, keep = take_rest(model, j, terms)
        x, other = x[keep], other[keep]
        theta, left = _solve(x, y)
        slope = (other - x) @ theta / DIFFERENCE
        both, after = _solve(np.column_stack([x, slope]), y)
        free = slope - x @ _solve(x, slope)[0]
        power = float(free @ free)
        if power <= 1e-12 * float(slope @ slope) or power == 0.0:
            fits[j] = _JointFit(left, left / max(len(y), 1), 0.0, np.inf)
            continue
        noise = after / max(len(y), 1)
        fits[j] = _JointFit(left, noise, float(both[-1]), float(np.sqrt(noise / power)))
    return fits


def reduce_term(term: Term, runs: list[PreparedRun]) -> np.ndarray:
    """Columns (M, m) of a term along runs in which only the directions of motion have changed."""
    made, shape = term.candidate, np.array(term.model_term.shape)[None]
    if not term.follows_direction:
        return term.at_joint(made.joint)
    parts = map_runs(partial(reduce_columns, made.effect, made.joint, shape), runs)
    return np.concatenate(parts)[:, list(term.subset)]


def _list_columns(model: Fit, joint: int, terms: list[int]) -> list[int]:
    """Parameters of a joint's own terms, and of its reversal."""
    each = list(zip(model.terms, model.spans, strict=True))
    own = [span for k, (_, span) in enumerate(each) if k in terms]
    own += [s for c, s in each if c.candidate.effect is REVERSAL and c.candidate.joint == joint]
    return [k for span in own for k in range(span.start, span.stop)]


def _solve(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, float]:
    """Least squares, and the sum of squares that it leaves."""
    scale = np.sqrt(np.maximum((x**2).sum(axis=0), 1e-300))
    theta = np.linalg.lstsq(x / scale, y, rcond=1e-10)[0] / scale
    return theta, float(((y - x @ theta) ** 2).sum())
