"""Wear of a joint's friction from the session that shows it, in the form that the simulator has.

A wear level is in percent of the healthy joint's friction. At 20, the RMS torque that wear adds along the
session's motion is a fifth of the RMS of the healthy friction along the reference's motion. Eq. (17) gives
the form of that torque: a bump at low speed and a slope. The bump's width is searched over a grid, and each
width is weighted by its likelihood.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.vocabulary import worn_effect
from wearscope.tracking.changes import FRICTION, Change
from wearscope.tracking.evidence import Evidence
from wearscope.tracking.reference import Reference
from wearscope.tracking.rows import RunRows

#: Widths of the bump that are tried, as shares of the joint's top speed.
WIDTHS = np.geomspace(0.01, 1.0, 16)
#: Number of draws for an interval, and their seed.
_DRAWS, _SEED = 4000, 17
#: Wear level at which the torque that wear adds is as large as the healthy friction.
WHOLE = 100.0


@dataclass(frozen=True)
class Worn:
    """Wear of one joint, as a session shows it.

    Attributes
    ----------
    joint : int
    level : float
        Wear level in this session, in percent of the healthy friction.
    values : mapping of str to float
        Parameters of the effect.
    intervals : mapping of str to (float, float)
        95 % intervals of the parameters that were estimated.
    """

    joint: int
    level: float
    values: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]


def identify_wear(reference: Reference, rows: Sequence[RunRows], named: Sequence[Change]) -> list[Worn]:
    """Wear at each joint whose friction grew in a session.

    Parameters
    ----------
    reference : Reference
    rows : sequence of RunRows
        Rows of the session's runs.
    named : sequence of Change
        Changes that the session shows.
    """
    worn = [
        fit_wear(reference, rows, change.joint, [other for other in named if other is not change])
        for change in named
        if change.kind == FRICTION
    ]
    return [one for one in worn if one is not None]


def fit_wear(
    reference: Reference, rows: Sequence[RunRows], joint: int, given: Sequence[Change]
) -> Worn | None:
    """Wear of a joint whose friction changed; None where it fell or the session does not show it."""
    structure, effect = reference.structure, worn_effect()
    widths = WIDTHS * float(structure.frame.top_speed[joint])
    rest = tuple(effect.pack({})[1][1:].tolist())
    every = tuple(range(len(effect.coefficients)))
    tried = [
        Change(f"{effect.name}{k}", joint, (ModelTerm(effect, joint, (w, *rest), every),), FRICTION)
        for k, w in enumerate(widths.tolist())
    ]
    evidence = Evidence(
        structure, [*given, *tried], reference.belief, reference.payload_prior, rows, reference.scatter
    )
    fits = [evidence.fit([*given, change]) for change in tried]
    misfit = [fit.strain + 0.5 * float(evidence.count @ (fit.fitted / evidence.variance)) for fit in fits]
    best = int(np.argmin(misfit))
    # Each column has the sign of the motion, so friction grew where their weighted sizes have a positive sum.
    z, value = evidence.z[:, joint, evidence.at[tried[best].key]], fits[best].values[tried[best].key]
    if float(np.sqrt((z**2).sum(axis=0)) @ value) <= 0.0:
        return None
    share = (
        np.sqrt(float(((z @ value) ** 2).sum()) / evidence.count[joint]) / structure.scales.friction[joint]
    )
    level = WHOLE * float(share)
    draws = np.random.default_rng(np.random.SeedSequence(_SEED))
    likely = np.exp(min(misfit) - np.array(misfit))
    picks = draws.choice(len(tried), _DRAWS, p=likely / likely.sum())
    step = float(np.log(WIDTHS[1] / WIDTHS[0]))
    drawn = np.empty((_DRAWS, len(every) + 1))
    for k, change in enumerate(tried):
        own = np.flatnonzero(picks == k)
        noise = draws.multivariate_normal(np.zeros(len(every)), fits[k].covariances[change.key], len(own))
        drawn[own, :-1] = fits[k].values[change.key] + noise
        drawn[own, -1] = widths[k] * np.exp(step * draws.uniform(-0.5, 0.5, len(own)))
    names = [*(p.name for p in effect.coefficients), effect.shape[0].name]
    low, high = np.quantile(drawn / level, [0.025, 0.975], axis=0)
    values = dict(zip(names, (np.append(value, widths[best]) / level).tolist(), strict=True))
    values |= {p.name: x for p, x in zip(effect.shape[1:], rest, strict=True)}
    intervals = {
        name: (min(a, values[name]), max(b, values[name]))
        for name, a, b in zip(names, low.tolist(), high.tolist(), strict=True)
    }
    return Worn(joint, level, values, intervals)


def record_worn(worn: Sequence[Worn], reference: Reference) -> list[dict[str, Any]]:
    """Entries of ``wear`` in ``tracking.json``."""
    structure, effect = reference.structure, worn_effect()
    known = {p.name: p for p in effect.parameters}
    units = list(zip(structure.position_unit, structure.torque_unit, strict=True))
    return [
        {
            "joint": structure.joints[one.joint],
            "effect": effect.name,
            "level": one.level,
            "parameters": {
                name: {
                    "value": one.values[name],
                    "ci95": list(interval),
                    "unit": known[name].unit_at(*units[one.joint]),
                }
                for name, interval in one.intervals.items()
            },
            "fixed": {name: value for name, value in one.values.items() if name not in one.intervals},
        }
        for one in worn
    ]
