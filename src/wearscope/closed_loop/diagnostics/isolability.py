"""Which effects the runs can separate at all: angles between candidates, before any of them is fitted."""

from itertools import combinations

import numpy as np
import pandas as pd

from wearscope.closed_loop.model.candidates import make_candidate
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.problem import Problem
from wearscope.closed_loop.selection.reversal import REVERSAL
from wearscope.effects.base import Effect, MeasurementEffect

#: Shapes of a nonlinear effect that represent all of them, spread over those worth trying.
_SHAPES = 9
#: Directions of an effect with a smaller sine to the declared model are not compared with other effects.
_LEAST_SINE = 0.03

UNITS = {"angle_deg": "deg", "largest_angle_deg": "deg", "sine_a": "1", "sine_b": "1"}


def _list_forms(problem: Problem, declared: Assembly, effect: Effect, joint: int) -> list[Chosen]:
    """Each plain variant of an effect at a joint, at some of its shapes; none where it is felt nowhere."""
    if isinstance(effect, MeasurementEffect):
        candidate = problem.measurement_candidate(effect, joint, declared)
    else:
        shapes = effect.shapes(problem.joined, joint)
        pick = np.unique(np.linspace(0, len(shapes) - 1, min(_SHAPES, len(shapes))).round().astype(int))
        candidate = make_candidate(effect, joint, problem.prepared, shapes[pick])
    if not candidate.joints:
        return []
    variants = [tuple(int(k) for k in subset) for subset in effect.plain_subsets()]
    return [Chosen(candidate.at(s), variant) for s in range(len(candidate.shapes)) for variant in variants]


def _whiten(gram: np.ndarray, inner: np.ndarray) -> tuple[np.ndarray, float]:
    """Orthonormal basis (m, r) of what the model leaves of one shape's columns; largest sine to the model."""
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    own, left = gram / np.outer(scale, scale), inner / np.outer(scale, scale)
    value, vector = np.linalg.eigh(own)
    good = value > 1e-9 * value[-1]
    if not good.any():
        return np.zeros((len(gram), 0)), 0.0
    base = vector[:, good] / np.sqrt(value[good])
    share, turn = np.linalg.eigh(base.T @ left @ base)
    sine = float(np.sqrt(np.clip(share[-1], 0.0, 1.0)))
    kept = share > _LEAST_SINE**2
    return (base @ turn[:, kept] / np.sqrt(share[kept])) / scale[:, None], sine


def _angles(declared: Assembly, forms: list[tuple[str, list[Chosen]]]) -> list[dict]:
    """One row for each pair of effects at a joint, of which the forms are given by name."""
    every = (*declared.chosen, *(form for _, own in forms for form in own))
    both = Assembly(declared.layout, declared.target, every, declared.sigma)
    p, gram = declared.p, both.gram.sum(axis=0)
    onto = np.linalg.solve(gram[:p, :p] + both.prior[:p, :p], gram[:p, p:])
    inner = gram[p:, p:] - gram[p:, :p] @ onto
    gram, inner = gram[p:, p:], 0.5 * (inner + inner.T)
    owners = [k for k, (_, own) in enumerate(forms) for _ in own]
    bases, sines = [], np.zeros(len(forms))
    for k, place in zip(owners, both.spans[len(declared.chosen) :], strict=True):
        span = slice(place.start - p, place.stop - p)
        small, sine = _whiten(gram[span, span], inner[span, span])
        sines[k] = max(sines[k], sine)
        full = np.zeros((len(gram), small.shape[1]))
        full[span] = small
        bases.append(full)
    ends = np.cumsum([0, *(b.shape[1] for b in bases)])
    whole = np.concatenate(bases, axis=1)
    cosines = whole.T @ inner @ whole
    records = []
    for a, b in combinations(range(len(forms)), 2):
        least, largest = np.nan, np.nan
        for i in (i for i, owner in enumerate(owners) if owner == a):
            for k in (k for k, owner in enumerate(owners) if owner == b):
                block = cosines[ends[i] : ends[i + 1], ends[k] : ends[k + 1]]
                if not block.size:
                    continue
                angle = np.degrees(np.arccos(np.clip(np.linalg.svd(block, compute_uv=False), 0.0, 1.0)))
                least, largest = np.fmin(least, angle[0]), np.fmin(largest, angle[-1])
        records.append(
            {
                "effect_a": forms[a][0],
                "effect_b": forms[b][0],
                "angle_deg": float(least),
                "largest_angle_deg": float(largest),
                "sine_a": sines[a],
                "sine_b": sines[b],
            }
        )
    return records


def measure_isolability(problem: Problem, model: Regression) -> pd.DataFrame:
    """Principal angles between all candidates at each joint once the declared model is projected out.

    Each candidate stands in its plainest variants.

    Parameters
    ----------
    problem : Problem
    model : Regression
        The declared model, refitted.

    Returns
    -------
    DataFrame
        One row a joint and pair of candidates: `angle_deg`, the smallest principal angle between them (Bjorck
        and Golub 1973), `largest_angle_deg`, that of the direction of the smaller one which the larger one
        reproduces worst, both over the shapes and variants at which they are most alike; `sine_a` and
        `sine_b` to the declared model, at the shape, variant and direction that it absorbs least. Angles are
        NaN where the declared model leaves nothing of one of the two.
    """
    prepared, last = problem.prepared, problem.prepared.n - 1
    base = tuple(c for c in problem.base if c.candidate.effect is not REVERSAL)
    declared = Assembly(problem.layout, problem.target, base, model.sigma)

    def list_forms(joint: int, per_robot: bool) -> list[tuple[str, list[Chosen]]]:
        asked = [e for e in problem.effects if e.per_robot == per_robot]
        usable = [e for e in asked if e.is_usable(problem.joined, joint)]
        return [(effect.name, _list_forms(problem, declared, effect, joint)) for effect in usable]

    common = list_forms(last, True) if prepared.moving[last] else []
    tables = []
    for j in map(int, np.flatnonzero(prepared.moving)):
        table = pd.DataFrame(_angles(declared, list_forms(j, False) + common))
        table.insert(0, "joint", prepared.dataset.joints[j])
        tables.append(table)
    return pd.concat(tables, ignore_index=True)
