"""Which effects the runs can separate at all: angles between candidates, before any of them is fitted."""

from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
import pandas as pd

from wearscope.closed_loop.model.candidates import reduce_columns
from wearscope.closed_loop.model.prediction import find_operating_point
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.selection.problem import Problem
from wearscope.effects.base import Effect, Signals

#: Shapes of a nonlinear effect that stand for all of them, spread over those worth trying.
_SHAPES = 9
#: Angle [deg] below which two effects are told not to be separable: one reproduces all but an eighth of the
#: other.
CLOSE = 7.0
#: Sine to the declared model below which it absorbs an effect: refitted, it leaves less than a tenth.
ABSORBED = 0.1
#: Directions of an effect with a smaller sine to the declared model are not compared with other effects.
_LEAST_SINE = 0.03

UNITS = {"angle_deg": "deg", "largest_angle_deg": "deg", "sine_a": "1", "sine_b": "1"}


@dataclass
class _Columns:
    """Weighted columns of an effect on the rows of all training runs.

    Attributes
    ----------
    name : str
    x : ndarray (R, C), or (R, n, C) where the effect spreads
        Each plain variant at each shape, side by side.
    counts : list of int
        Columns of each.
    """

    name: str
    x: np.ndarray
    counts: list[int]


def _stack_columns(
    effect: Effect, joint: int, model: Regression, joined: Signals, along: list[Signals]
) -> _Columns:
    shapes = effect.shapes(joined, joint)
    pick = np.unique(np.linspace(0, len(shapes) - 1, min(_SHAPES, len(shapes))).round().astype(int))
    variants = effect.plain_subsets()
    kept = [s * len(effect.coefficients) + variant for s in range(len(pick)) for variant in variants]
    parts = []
    for run, w, signals in zip(model.prepared.runs_for("train"), model.weights, along, strict=True):
        x = reduce_columns(effect, joint, shapes[pick], run, signals)[..., np.concatenate(kept)]
        parts.append(x * (w[:, :, None] if effect.spread else w[:, [joint]]))
    return _Columns(effect.name, np.concatenate(parts), [len(k) for k in kept])


def _project(model: Regression, candidates: list[_Columns], joint: int) -> tuple[np.ndarray, np.ndarray]:
    """Gram matrices of all candidates' columns, before and after the model is projected out."""
    d = np.concatenate([x * w[:, :, None] for x, w in zip(model.columns, model.weights, strict=True)])
    width = sum(c.x.shape[-1] for c in candidates)
    gram, cross = np.zeros((width, width)), np.zeros((width, model.p))
    ends = np.cumsum([0, *(c.x.shape[-1] for c in candidates)])
    spans = [slice(a, b) for a, b in pairwise(ends)]
    for a, here in zip(candidates, spans, strict=True):
        if a.x.ndim == 3:
            cross[here] = a.x.reshape(-1, a.x.shape[-1]).T @ d.reshape(-1, model.p)
        else:
            cross[here] = a.x.T @ d[:, joint]
        for b, there in zip(candidates, spans, strict=True):
            if there.start < here.start:
                continue
            if a.x.ndim == b.x.ndim:
                product = a.x.reshape(-1, a.x.shape[-1]).T @ b.x.reshape(-1, b.x.shape[-1])
            else:
                left, right = (c.x[:, joint] if c.x.ndim == 3 else c.x for c in (a, b))
                product = left.T @ right
            gram[here, there], gram[there, here] = product, product.T
    if not model.p:
        return gram, gram
    inner = gram - cross @ np.linalg.solve(model.moments()[0], cross.T)
    return gram, 0.5 * (inner + inner.T)


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


def _angles(model: Regression, candidates: list[_Columns], joint: int) -> list[dict]:
    """One row for each pair of candidates at a joint."""
    gram, inner = _project(model, candidates, joint)
    bases: list[np.ndarray] = []
    owners: list[int] = []
    sines = np.zeros(len(candidates))
    start = 0
    for k, c in enumerate(candidates):
        for count in c.counts:
            span = slice(start, start + count)
            start += count
            small, sine = _whiten(gram[span, span], inner[span, span])
            sines[k] = max(sines[k], sine)
            full = np.zeros((len(gram), small.shape[1]))
            full[span] = small
            bases.append(full)
            owners.append(k)
    ends = np.cumsum([0, *(b.shape[1] for b in bases)])
    whole = np.concatenate(bases, axis=1)
    cosines = whole.T @ inner @ whole
    records = []
    for a, b in combinations(range(len(candidates)), 2):
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
                "effect_a": candidates[a].name,
                "effect_b": candidates[b].name,
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
    prepared, joined = problem.prepared, problem.joined
    along = find_operating_point(model)
    last = prepared.n - 1

    def stack(joint: int, per_robot: bool) -> list[_Columns]:
        asked = (e for e in problem.effects if e.per_robot == per_robot and e.is_usable(joined, joint))
        return [_stack_columns(effect, joint, model, joined, along) for effect in asked]

    common = stack(last, True) if prepared.moving[last] else []
    tables = []
    for j in map(int, np.flatnonzero(prepared.moving)):
        table = pd.DataFrame(_angles(model, stack(j, False) + common, j))
        table.insert(0, "joint", prepared.dataset.joints[j])
        tables.append(table)
    return pd.concat(tables, ignore_index=True)
