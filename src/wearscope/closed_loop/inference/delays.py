"""Whether a joint's torque is truly delayed: a delay is the same away from reversals and at low frequencies.

The form of a friction's reversal looks like a delay where the joint reverses. Torque noise inside a position
loop moves the joint, most of all near the loop's bandwidth. The residual torque then follows the motion that
it caused, with a lag that grows with the frequency (Soderstrom and Stoica 1989, System Identification, ch.
10), whereas a delay is the same time at all frequencies.
"""

import numpy as np

from wearscope.closed_loop.inference.gram import Fit, Gram
from wearscope.closed_loop.inference.series import bridge_uncounted, take_out
from wearscope.closed_loop.inference.term import Term
from wearscope.closed_loop.intake.filtering import low_pass
from wearscope.effects.base import Effect, MeasurementEffect

#: Factor within which a delay is the same in a part of the torque.
_ALIKE = 1.5
#: A joint is away from its reversals above this share of its largest speed; this share of its rows must be.
_AWAY = 0.2
#: Share of the common cut-off below which a delay must be the same: two octaves away from frequencies at
#: which a position loop answers the noise of the torque.
_SLOW = 0.25


def is_lag(effect: Effect) -> bool:
    """Whether an effect delays the torque that is measured."""
    return isinstance(effect, MeasurementEffect) and effect.kind == "lag"


def _is_alike(delay: float, other: float) -> bool:
    """Whether a delay is the same in a part of the torque, or larger there, as reversals may hide some."""
    return 1.0 / _ALIKE <= other / delay <= _ALIKE**2


def lags_away_from_reversals(given: Fit, term: Term, speed: np.ndarray) -> bool:
    """Whether a delay is the same where its joint does not reverse; True also where too few rows tell.

    Parameters
    ----------
    given : Fit
        The model without the term.
    term : Term
    speed : ndarray (M,)
        Of its joint, at the rows of the training runs.
    """
    own = float(given.add(term.candidate, term.subset).beta[term.shape, 0])
    layout = given.gram.layout
    kept = layout.keep[:, term.joint]
    fast = np.abs(speed) > _AWAY * np.abs(speed).max()
    if np.mean(fast[kept]) < _AWAY:
        return True
    away = Fit(Gram(layout.restrict(term.joint, fast), given.gram.target), given.terms, given.sigma)
    return _is_alike(own, float(away.add(term.candidate, term.subset).beta[term.shape, 0]))


def lags_slow_torque(given: Fit, term: Term) -> bool:
    """Whether a delay may be the same far below the common cut-off.

    Test it conditional on all other terms that were found: a poorer model may leave anything there.
    """
    own = float(given.add(term.candidate, term.subset).beta[term.shape, 0])
    beta, error = fit_below(given, term, _SLOW * given.gram.layout.prepared.band.torque)
    return _is_alike(own, beta) or abs(beta - own) <= 2.0 * error


def fit_below(given: Fit, term: Term, cutoff: float) -> tuple[float, float]:
    """A term's first coefficient conditional on a model, below a frequency, and its standard error.

    Parameters
    ----------
    given : Fit
    term : Term
    cutoff : float
        [Hz]

    Returns
    -------
    float, float
        The error with blocks as clusters; infinite where nothing of the term is left there.
    """
    layout, joint = given.gram.layout, term.joint
    own = term.at_joint(joint)[:, :1]
    rate = layout.prepared.band.rate / layout.prepared.band.stride
    # Linear about the model that all joints fit: what they tell of its coefficients holds here too.
    columns = given.columns(joint)
    both = np.concatenate([columns, own, given.leave(joint)[:, None]], axis=1)
    kept = layout.unpack(layout.keep[:, joint])
    slow = np.concatenate(
        [
            low_pass(bridge_uncounted(x, k), cutoff, rate)
            for x, k in zip(layout.unpack(both), kept, strict=True)
        ]
    )
    slow *= layout.keep[:, joint][:, None]
    known = given.know_elsewhere(joint) * given.sigma[joint] ** 2
    rest = take_out(slow[:, :-2], known, slow[:, -2:])
    column, left = rest[:, 0], rest[:, 1]
    information = float(column @ column)
    if not information > 0.0:
        return 0.0, np.inf
    beta = float(column @ left) / information
    scores = layout.sum_blocks(column * (left - beta * column))
    return beta, float(np.sqrt(np.sum(scores**2))) / information
