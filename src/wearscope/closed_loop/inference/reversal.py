"""Errors of friction's reversal: the speed over which each joint's direction of motion changes.

What an error of the width and form leaves is a term of every model to which candidates are added. So no name
is given for a reversal that is a little sharper or smoother than assumed.
"""

from dataclasses import replace

import numpy as np

from wearscope.closed_loop.inference.term import Term
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.intake.rough_model import fit_rough, rough_columns
from wearscope.closed_loop.model.terms import make_candidate
from wearscope.effects.base import Effect, Parameter, Signals

#: Prior standard deviation of the errors of width and form, as a share of Coulomb friction.
_SHARE = 0.5
#: Largest width that drives have, over the largest speed: a wider reversal represents a law of the speed.
WIDEST = 0.05


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


def is_wide(prepared: Prepared, joint: int) -> bool:
    """Whether a joint's reversal is wider than any drive's: then it represents a law of the joint's speed."""
    return float(prepared.reversals.width[joint]) > WIDEST * find_top(prepared)[joint]


def find_top(prepared: Prepared) -> np.ndarray:
    """Largest speed of each joint (n,) along the training runs."""
    return np.max([np.abs(run.signals.v).max(axis=0) for run in prepared.runs_for("train")], axis=0)
