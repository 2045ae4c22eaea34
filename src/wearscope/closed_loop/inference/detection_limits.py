"""How large an effect may be without a name: noise hides it, or the model's own parameters absorb it."""

from collections.abc import Sequence

import numpy as np

from wearscope.closed_loop.inference.extensions import list_candidates, list_subsets
from wearscope.closed_loop.inference.moves import SURELY
from wearscope.closed_loop.inference.score import Model, Score
from wearscope.closed_loop.inference.term import Term
from wearscope.closed_loop.model.terms import Candidate
from wearscope.effects.base import MeasurementEffect

#: Share of a joint's torque (RMS) from which a limit is told in words.
LARGE = 0.05
#: A column with a smaller square counts as zero, as at a joint that rests.
_NOTHING = 1e-200


def find_limits(model: Model, score: Score) -> list[dict[str, float]]:
    """By joint, the size below which an effect gets no name there.

    An effect adds its power to what the model leaves, times the squared sine of its angle to the model's
    columns. Friction and refitted masses take up the rest.

    Parameters
    ----------
    model : Model
        With all names.
    score : Score

    Returns
    -------
    list of dict of str to float
        By effect its RMS torque over that of the joint: of its shapes and variants the median. Infinite where
        no size gets a name.
    """
    problem, fit = model.problem, model.fit
    size, _ = problem.layout.torque_size
    limits: list[dict[str, float]] = [{} for _ in size]
    candidates = list_candidates(model, range(len(size)))
    listed = [(c, list_subsets(c.effect, by_run=False)) for c in candidates]
    tried = np.zeros(len(size))
    for c, subsets in listed:
        tried[c.joint] += len(c.shapes) * c.tried * len(subsets)
    for candidate, subsets in listed:
        effect, j = candidate.effect, candidate.joint
        if effect.spread or effect.is_in_every_drive or isinstance(effect, MeasurementEffect):
            continue
        own = [_find_sizes(model, score, candidate, subset, float(tried[j])) for subset in subsets]
        limits[j][effect.name] = float(fit.sigma[j] / size[j] * np.median(np.concatenate(own)))
    return limits


def _find_sizes(
    model: Model, score: Score, candidate: Candidate, subset: Sequence[int], tried: float
) -> np.ndarray:
    """RMS torque in residual scales from which each shape (S,) of a candidate gets a name."""
    fit, joint, m = model.fit, candidate.joint, len(subset)
    rows = float(fit.gram.count[joint])
    added = fit.add(candidate, subset)
    gram = added.own + (1e-9 * np.einsum("smm->sm", added.own) + _NOTHING)[..., None] * np.eye(m)
    squares = np.trace(np.linalg.solve(gram, added.inner), axis1=1, axis2=2) / m
    named = model.extend(Term(candidate, tuple(subset), 0, tried))
    loss = (fit.fitted[joint] + score.find_form(model, named)[joint]) * fit.weight[joint]
    odds = score.find_odds(named, named.terms[-1])
    left = fit.leave(joint) * fit.gram.layout.keep[:, joint]
    sizes = []
    for s, square in enumerate(squares):
        term = Term(candidate, tuple(subset), s, tried)
        informing = min(score.count_rows(x * left, int(rows)) for x in term.at_joint(joint).T)
        cost = 0.5 * score.count(term) * np.log(informing) + odds + SURELY
        ratio = np.expm1(min(2.0 * cost / informing, 700.0))
        sizes.append(np.sqrt(ratio * loss / rows / max(float(square), 1e-12)))
    return np.array(sizes)


def say_limit(share: float) -> str:
    """A share in words."""
    return f"{100 * share:.0f} %" if share < 1.0 else "all"


def tell_limits(limits: Sequence[dict[str, float]], joints: Sequence[str]) -> list[str]:
    """A sentence on joints at which a large effect gets no name; none where there is no such joint."""
    where = [
        joint for joint, own in zip(joints, limits, strict=True) if max(own.values(), default=0.0) > LARGE
    ]
    if not where:
        return []
    return [
        f"{', '.join(where)}: on these runs friction, refitted masses and noise can hide effects of more "
        f"than {say_limit(LARGE)} of the torque (RMS). detection_limit_percent in verdict.json lists them."
    ]
