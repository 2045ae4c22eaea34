"""What wear adds to a joint's friction, in the form that the simulator has, from the session that shows it.

A wear level counts in percent of the healthy joint's friction: at 20 the RMS torque of worn friction along
the session's motion is a fifth of that of the healthy friction along the reference's. What the form of
eq. (17) adds at that level is the session's change: a bump at low speed and a slope, the bump's width
searched over a grid, each width as likely as its fit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import Effect
from wearscope.effects.vocabulary import worn_effect
from wearscope.tracking.changes import Change
from wearscope.tracking.decision import Named, excludes
from wearscope.tracking.inference import Estimate, estimate_change, make_sample
from wearscope.tracking.reference import Reference
from wearscope.tracking.rows import RunRows, stack_rows
from wearscope.tracking.scatter import Scatter

#: Widths of the bump that are tried, as shares of the joint's top speed.
WIDTHS = np.geomspace(0.01, 1.0, 16)
#: Draws that make an interval, and their seed.
_DRAWS, _SEED = 4000, 17
#: Wear level at which the worn friction is as large as the healthy one.
WHOLE = 100.0


@dataclass(frozen=True)
class Worn:
    """Wear of one joint, as a session shows it.

    Attributes
    ----------
    joint : int
    level : float
        Of wear in this session, in percent of the healthy friction.
    values : mapping of str to float
        Parameters of the effect.
    intervals : mapping of str to (float, float)
        95 % intervals of those that were estimated.
    """

    joint: int
    level: float
    values: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]


def identify_wear(reference: Reference, rows: Sequence[RunRows], named: Sequence[Named]) -> list[Worn]:
    """Wear at each joint whose friction grew in a session.

    Parameters
    ----------
    reference : Reference
    rows : sequence of RunRows
        Of the session's runs.
    named : sequence of Named
        What changed in it.
    """
    found = []
    for one in named:
        if not one.change.friction:
            continue
        given = [other.change for other in named if not excludes(other.change, one.change)]
        worn = fit_wear(reference, rows, one.change, given)
        if worn is not None:
            found.append(worn)
    return found


def fit_wear(
    reference: Reference, rows: Sequence[RunRows], change: Change, given: Sequence[Change]
) -> Worn | None:
    """Wear of the joint of a change of friction; None where friction fell or the session does not show it."""
    structure, effect, joint = reference.structure, worn_effect(), change.joint
    widths = WIDTHS * float(structure.frame.top_speed[joint])
    rest = tuple(effect.pack({})[1][1:].tolist())
    every = tuple(range(len(effect.coefficients)))
    tried = [
        replace(
            change,
            name=f"{effect.name}{k}",
            terms=(ModelTerm(effect, joint, (w, *rest), every),),
            asked=False,
        )
        for k, w in enumerate(widths.tolist())
    ]
    changes = [*given, *tried]
    sample = make_sample(
        stack_rows(structure, changes, rows), changes, reference.belief, reference.payload_prior
    )
    fits = [estimate_change(sample, one, given) for one in tried]
    known = [(w, replace(fit, change=replace(fit.change, name=effect.name)))
             for w, fit in zip(widths.tolist(), fits, strict=True) if fit is not None]  # fmt: skip
    if not known:
        return None
    width, best = max(known, key=lambda pair: pair[1].gain)
    if grows(best) <= 0.0:
        return None
    level = WHOLE * best.torque
    drawn = draw_wear(known, reference.scatter, np.random.default_rng(np.random.SeedSequence(_SEED))) / level
    names = [*(p.name for p in effect.coefficients), effect.shape[0].name]
    low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
    values = dict(zip(names, (np.append(best.value, width) / level).tolist(), strict=True))
    values |= {p.name: value for p, value in zip(effect.shape[1:], rest, strict=True)}
    intervals = {
        name: (min(a, values[name]), max(b, values[name]))
        for name, a, b in zip(names, low.tolist(), high.tolist(), strict=True)
    }
    return Worn(joint, level, values, intervals)


def grows(estimate: Estimate) -> float:
    """Sign of the power that a change of friction takes along the motion."""
    # Each column is felt with the sign of the motion, so that the sum of its torques tells the sign.
    return float(np.sqrt(np.maximum(np.diag(estimate.shares), 0.0)) @ estimate.value)


def draw_wear(
    known: Sequence[tuple[float, Estimate]], scatter: Scatter, rng: np.random.Generator
) -> np.ndarray:
    """Torques and width (`_DRAWS`, m + 1) that the session allows.

    Parameters
    ----------
    known : sequence of (float, Estimate)
        Width and fit; widths in geometric steps.
    scatter : Scatter
    rng : Generator
    """
    gains = np.array([fit.gain for _, fit in known])
    likely = np.exp(0.5 * (gains - gains.max()))
    picks = rng.choice(len(known), _DRAWS, p=likely / likely.sum())
    step = float(np.log(WIDTHS[1] / WIDTHS[0]))
    tails = np.sqrt(scatter.dof / rng.chisquare(scatter.dof, _DRAWS))
    found = np.empty((_DRAWS, len(known[0][1].value) + 1))
    for k, (width, fit) in enumerate(known):
        own = np.flatnonzero(picks == k)
        noise = rng.multivariate_normal(np.zeros(len(fit.value)), scatter.covariance(fit), len(own))
        found[own, :-1] = fit.value + tails[own, None] * noise
        found[own, -1] = width * np.exp(step * rng.uniform(-0.5, 0.5, len(own)))
    return found


def record_worn(worn: Sequence[Worn], reference: Reference) -> list[dict[str, Any]]:
    """Entries of ``tracking.json``."""
    structure, effect = reference.structure, worn_effect()
    return [
        {
            "joint": structure.joints[one.joint],
            "effect": effect.name,
            "level": one.level,
            "parameters": {
                name: {
                    "value": one.values[name],
                    "ci95": list(interval),
                    "unit": _unit(effect, name, one, reference),
                }
                for name, interval in one.intervals.items()
            },
            "fixed": {name: value for name, value in one.values.items() if name not in one.intervals},
        }
        for one in worn
    ]


def _unit(effect: Effect, name: str, worn: Worn, reference: Reference) -> str:
    structure = reference.structure
    parameter = next(p for p in effect.parameters if p.name == name)
    return parameter.unit_at(structure.position_unit[worn.joint], structure.torque_unit[worn.joint])
