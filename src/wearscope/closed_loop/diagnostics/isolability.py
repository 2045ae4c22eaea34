"""Which effects the runs can separate at all: angles between candidates, before any of them is fitted."""

from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
import pandas as pd

from wearscope.closed_loop.model.prediction import update_prediction
from wearscope.closed_loop.model.candidates import applies, candidate_names, joined_signals, reduce_columns
from wearscope.closed_loop.intake.preprocessing import Prepared
from wearscope.closed_loop.model.regression import Regression
from wearscope.effects.base import Effect, load_effect

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
class _Candidate:
    """Weighted columns of an effect on the rows of all training runs.

    Attributes
    ----------
    name : str
    x : ndarray (R, S*m), or (R, n, S*m) where the effect spreads
    count : int
        Columns m of each shape.
    """

    name: str
    x: np.ndarray
    count: int


def _make_candidate(effect: Effect, joint: int, model: Regression, shapes: np.ndarray) -> _Candidate:
    pick = np.unique(np.linspace(0, len(shapes) - 1, min(_SHAPES, len(shapes))).round().astype(int))
    parts = []
    for run, w in zip(model.prepared.runs_for("train"), model.weights, strict=True):
        x = reduce_columns(effect, joint, shapes[pick], run)
        parts.append(x * (w[:, :, None] if effect.spread else w[:, [joint]]))
    return _Candidate(effect.name, np.concatenate(parts), len(effect.coefficients))


def _project(model: Regression, candidates: list[_Candidate], joint: int) -> tuple[np.ndarray, np.ndarray]:
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
    base = vector[:, good] / np.sqrt(value[good])
    share, turn = np.linalg.eigh(base.T @ left @ base)
    sine = float(np.sqrt(np.clip(share[-1], 0.0, 1.0)))
    kept = share > _LEAST_SINE**2
    return (base @ turn[:, kept] / np.sqrt(share[kept])) / scale[:, None], sine


def _angles(model: Regression, candidates: list[_Candidate], joint: int) -> list[dict]:
    """One row for each pair of candidates at a joint."""
    gram, inner = _project(model, candidates, joint)
    bases: list[np.ndarray] = []
    owners: list[int] = []
    sines = np.zeros(len(candidates))
    start = 0
    for k, c in enumerate(candidates):
        for first in range(start, start + int(c.x.shape[-1]), c.count):
            span = slice(first, first + c.count)
            small, sine = _whiten(gram[span, span], inner[span, span])
            sines[k] = max(sines[k], sine)
            full = np.zeros((len(gram), small.shape[1]))
            full[span] = small
            bases.append(full)
            owners.append(k)
        start += int(c.x.shape[-1])
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


def measure_isolability(prepared: Prepared, model: Regression) -> pd.DataFrame:
    """Principal angles between all candidates at each joint once the declared model is projected out.

    Parameters
    ----------
    prepared : Prepared
    model : Regression
        The declared model, refitted.

    Returns
    -------
    DataFrame
        One row a joint and pair of candidates: `angle_deg`, the smallest principal angle between them (Bjorck
        and Golub 1973), `largest_angle_deg`, that of the direction of the smaller one which the larger one
        reproduces worst, both over the shapes at which they are most alike; `sine_a` and `sine_b` to the
        declared model, at the shape and in the direction that it absorbs least. Angles are NaN where the
        declared model leaves nothing of one of the two.
    """
    fields = prepared.dataset.fields
    names = candidate_names(fields.declared_effects, fields.robot.rotor_inertia is not None)
    joined = joined_signals(prepared.runs_for("train"))
    update_prediction(model)
    common = []
    last = prepared.n - 1
    payload = load_effect("payload_error")
    if "payload_error" in names and applies(payload, last, prepared):
        common.append(_make_candidate(payload, last, model, payload.shapes(joined, last)))
    tables = []
    for j in map(int, np.flatnonzero(prepared.moving)):
        candidates = [
            _make_candidate(effect, j, model, effect.shapes(joined, j))
            for effect in map(load_effect, names)
            if effect.name != "payload_error" and applies(effect, j, prepared)
        ]
        table = pd.DataFrame(_angles(model, candidates + common, int(j)))
        table.insert(0, "joint", prepared.dataset.joints[j])
        tables.append(table)
    return pd.concat(tables, ignore_index=True)
