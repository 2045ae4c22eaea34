"""Whether what delays a joint's whole torque is one: the same away from reversals, and at low frequencies.

The form of a friction's reversal looks like a delay where the joint reverses. Noise of the torque inside a
position loop moves the joint, the more the nearer to the loop's own bandwidth: what is left of the torque
then goes with the motion that it caused, by a time that grows with the frequency (Soderstrom and Stoica 1989,
System Identification, ch. 10), where a delay is one time at all frequencies.
"""

import numpy as np

from wearscope.closed_loop.intake.filtering import low_pass
from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.evidence import Evidence, weigh
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.whitening import bridge_uncounted, take_out
from wearscope.effects.base import Effect, MeasurementEffect


def is_lag(effect: Effect) -> bool:
    """Whether an effect delays the torque that is measured."""
    return isinstance(effect, MeasurementEffect) and effect.kind == "lag"


def lags_away_from_reversals(assembly: Assembly, e: Evidence, speed: np.ndarray, policy: Policy) -> bool:
    """Whether a delay is alike where its joint does not reverse; also where that cannot be asked.

    Parameters
    ----------
    assembly : Assembly
        The model to which it was to be added.
    e : Evidence
    speed : ndarray (M,)
        Of its joint, at the rows of the training runs.
    policy : Policy
    """
    fast = rule.find_fast(speed, assembly.layout.keep[:, e.joint], policy)
    if fast is None:
        return True
    layout = assembly.layout.restrict(e.joint, fast)
    away = Assembly(layout, assembly.target, assembly.chosen, assembly.sigma)
    other = weigh(away, e.chosen.candidate, e.chosen.subset, policy)
    return rule.is_alike(float(e.beta[0]), float(other.beta[0]), policy)


def lags_slow_torque(assembly: Assembly, e: Evidence, policy: Policy) -> bool:
    """Whether a delay is alike far below the common cut-off, or cannot be told from one that is.

    To be asked given all else that was found: what a model leaves that lacks it may be anything there.
    """
    beta, error = fit_below(assembly, e, policy.slow * assembly.layout.prepared.band.torque)
    own = float(e.beta[0])
    return rule.is_alike(own, beta, policy) or abs(beta - own) <= policy.told_apart * error


def fit_below(assembly: Assembly, e: Evidence, cutoff: float) -> tuple[float, float]:
    """A term's first coefficient given a model, at its joint and below a frequency, and its standard error.

    Parameters
    ----------
    assembly : Assembly
    e : Evidence
    cutoff : float
        [Hz]

    Returns
    -------
    float, float
        The error with blocks as clusters; infinite where nothing of the term is left there.
    """
    layout, joint = assembly.layout, e.joint
    own = e.chosen.rows[e.chosen.candidate.joints.index(joint)][:, :1]
    rate = layout.prepared.band.rate / layout.prepared.band.stride
    # About the model as all joints fit it: what they know of its coefficients holds there.
    both = np.concatenate([assembly.columns[joint], own, assembly.residual[:, [joint]]], axis=1)
    every = layout.unpack(both)
    kept = layout.unpack(layout.keep[:, joint])
    slow = np.concatenate(
        [low_pass(bridge_uncounted(x, k), cutoff, rate) for x, k in zip(every, kept, strict=True)]
    )
    slow *= layout.keep[:, joint][:, None]
    known = assembly.know_elsewhere(joint) * assembly.sigma[joint] ** 2
    rest = take_out(slow[:, :-2], known, slow[:, -2:])
    column, left = rest[:, 0], rest[:, 1]
    information = float(column @ column)
    if not information > 0.0:
        return 0.0, np.inf
    beta = float(column @ left) / information
    scores = layout.sum_blocks(column * (left - beta * column))
    return beta, float(np.sqrt(np.sum(scores**2))) / information
