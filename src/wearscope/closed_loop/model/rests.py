"""Names that motion does not tell apart, but the torque at rest does.

Rows at rest do not count in any fit, since static friction may hold any torque there. Where a joint shows the
same torque at rest from whichever side it came, no static friction holds it. If one name predicts this torque
and the other does not, the rests tell the two apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from wearscope.closed_loop.intake.filtering import rows
from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.closed_loop.model.prediction import refit
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm

#: Largest error at rest of the name that stays, and largest difference of the two names in motion, both over
#: their difference at rest.
CLOSE = 0.25
#: Fewest rests after a motion in each direction.
LEAST = 2
#: Confidence level of the scatter of rests at a joint without static friction.
_USUAL = 0.999
#: Shortest stretch at rest that counts [rows].
_SHORTEST = 4


@dataclass(frozen=True)
class Rest:
    """The middle of a stretch at rest.

    Attributes
    ----------
    run : int
        Index among the training runs.
    rows : slice
        Rows of the run at the common bandwidth.
    forwards : bool
        Whether the joint came to rest from a motion forwards.
    """

    run: int
    rows: slice
    forwards: bool


def find_rests(run: PreparedRun, joint: int, number: int = 0) -> list[Rest]:
    """Middle half of each of a joint's rests in a run that follow a motion."""
    at = rows(run.band, len(run.signals.t))
    sign = run.signals.sign[at][:, joint]
    edges = np.flatnonzero(np.diff((sign == 0.0).astype(int), prepend=0, append=0))
    found = []
    for start, stop in edges.reshape(-1, 2).tolist():
        if start == 0 or stop - start < _SHORTEST:
            continue
        quarter = (stop - start) // 4
        found.append(Rest(number, slice(start + quarter, stop - quarter), bool(sign[start - 1] > 0.0)))
    return found


def list_rests(model: Regression, joint: int) -> list[Rest]:
    """Rests of a joint in all training runs."""
    train = model.prepared.runs_for("train")
    return [rest for k, run in enumerate(train) for rest in find_rests(run, joint, k)]


def are_enough(rests: Sequence[Rest]) -> bool:
    """Whether a joint came to rest often enough from either side."""
    forwards = sum(rest.forwards for rest in rests)
    return min(forwards, len(rests) - forwards) >= LEAST


@dataclass(frozen=True)
class Left:
    """Residuals of a model at a joint, at rest and in motion.

    Attributes
    ----------
    still : ndarray (R,)
        Mean residual at each rest.
    forwards : ndarray (R,) of bool
        Whether the motion before each rest was forwards.
    moving : ndarray (M,)
        Residual in each row in motion.
    error : float
        Standard deviation of a mean over as many rows in motion as a rest has.
    """

    still: np.ndarray
    forwards: np.ndarray
    moving: np.ndarray
    error: float


def measure_left(model: Regression, joint: int, rests: Sequence[Rest], length: int) -> Left:
    """Residuals of a model at a joint: at rests of about `length` rows, and in motion."""
    residuals = model.residuals(model.solve())
    still = np.array([np.mean(residuals[rest.run][rest.rows, joint]) for rest in rests])
    train = model.prepared.runs_for("train")
    moving = [e[run.keep[:, joint], joint] for e, run in zip(residuals, train, strict=True)]
    means = [
        e[: len(e) // length * length].reshape(-1, length).mean(axis=1) for e in moving if len(e) >= length
    ]
    error = float(np.sqrt(np.mean(np.concatenate(means) ** 2))) if means else np.inf
    return Left(still, np.array([rest.forwards for rest in rests], dtype=bool), np.concatenate(moving), error)


def is_refuted(one: Left, other: Left) -> bool:
    """Whether rests refute a name while another name fits them.

    The other name fits the torque after motions in both directions, and the rests scatter no more than rows
    in motion; with static friction they would scatter more.
    """
    apart = float(np.sqrt(np.mean((one.still - other.still) ** 2)))
    in_motion = float(np.sqrt(np.mean((one.moving - other.moving) ** 2)))
    if not in_motion < CLOSE * apart:
        return False
    sides = [other.still[other.forwards], other.still[~other.forwards]]
    if any(abs(float(side.mean())) >= CLOSE * apart for side in sides):
        return False
    count = len(other.still)
    most = other.error**2 * float(stats.chi2.ppf(_USUAL, count)) / count + (CLOSE * apart) ** 2
    return float(np.mean(other.still**2)) <= most


def replace_term(model: Regression, index: int, term: ModelTerm) -> Regression:
    """The model with another term in an entry's place."""
    entries = list(model.entries)
    entries[index] = term
    return refit(model, entries)


def settle_at_rest(
    model: Regression, index: int, rivals: Sequence[ModelTerm | None]
) -> tuple[Regression, list[int]]:
    """The names of a term that rests do not refute.

    Parameters
    ----------
    model : Regression
    index : int
        Index of the term among the model's entries.
    rivals : sequence of ModelTerm or None
        Terms with the other names; None for a name that cannot be fitted.

    Returns
    -------
    model : Regression
        Model with the name that stays.
    left : list of int
        Names that stay, the one in the model first: 0 is the term's own name, 1 and up are the rivals.
    """
    every = list(range(1 + len(rivals)))
    joint = model.entries[index].joint
    rests = list_rests(model, joint)
    if not are_enough(rests):
        return model, every
    models = {0: model} | {
        k: replace_term(model, index, term) for k, term in enumerate(rivals, start=1) if term is not None
    }
    length = max(1, int(np.median([rest.rows.stop - rest.rows.start for rest in rests])))
    left = {k: measure_left(one, joint, rests, length) for k, one in models.items()}
    refuted = {k for k in left for other in left if other != k and is_refuted(left[k], left[other])}
    stays = [k for k in every if k not in refuted]
    chosen = next((k for k in stays if k in models), 0)
    return models[chosen], [chosen, *(k for k in stays if k != chosen)]
