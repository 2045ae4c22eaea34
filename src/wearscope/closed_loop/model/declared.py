"""The declared model: terms of the declared effects, weighted by the scale of their residual."""

from collections.abc import Sequence

import numpy as np

from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.blocks import Block
from wearscope.closed_loop.model.regression import ROUNDS, SETTLED, Regression
from wearscope.closed_loop.model.terms import ModelTerm, reduce_columns
from wearscope.effects.base import Effect, RigidBodyEffect, Signals


def declared_terms(
    prepared: Prepared, effects: Sequence[Effect], given: Sequence[Effect], joined: Signals
) -> list[ModelTerm]:
    """Terms of the declared effects that have parameters to fit, joint by joint.

    Parameters
    ----------
    prepared : Prepared
    effects : sequence of Effect
        The declared effects.
    given : sequence of Effect
        Declared effects whose values the data set gives.
    joined : Signals
        Signals of all training runs, from which shapes are chosen.
    """
    terms = []
    for effect in effects:
        if effect in given or isinstance(effect, RigidBodyEffect):
            continue
        for joint in range(prepared.n):
            if not prepared.moving[joint] or (effect.per_robot and joint != prepared.n - 1):
                continue
            if not effect.is_usable(joined, joint):
                continue
            term = fit_declared(prepared, effect, joint, joined)
            if term is not None:
                terms.append(term)
    return terms


def fit_declared(prepared: Prepared, effect: Effect, joint: int, joined: Signals) -> ModelTerm | None:
    """Term of a declared effect, with its best fitting shape and the coefficients that signals determine.

    Coefficients whose regressor is zero (wear of unknown level) or unknown (a temperature that was not
    recorded) are left out; None where all are.
    """
    shapes = effect.shapes(joined, joint)
    subset = effect.subsets()[-1]
    train = prepared.runs_for("train")
    best, least = None, np.inf
    for shape in shapes if len(shapes) > 1 else shapes[:1]:
        x = np.concatenate([reduce_columns(effect, joint, shape[None], run) for run in train])
        own = x[:, joint] if effect.spread else x
        usable = [int(k) for k in subset if np.isfinite(own[:, k]).all() and np.any(own[:, k])]
        if not usable:
            continue
        if len(shapes) == 1:
            return ModelTerm(effect, joint, tuple(float(v) for v in shape), tuple(usable))
        keep = np.concatenate([run.keep[:, joint] for run in train])
        y = np.concatenate([run.measured[:, joint] for run in train])[keep]
        known = np.concatenate([run.reduce(run.known[:, [joint]]) for run in train])[keep]
        a = np.column_stack([own[keep][:, usable], known, np.ones(len(y))])
        scale = np.sqrt(np.maximum((a**2).mean(axis=0), 1e-300))
        loss = float(((y - a @ (np.linalg.lstsq(a / scale, y, rcond=1e-9)[0] / scale)) ** 2).sum())
        if loss < least:
            least, best = loss, ModelTerm(effect, joint, tuple(float(v) for v in shape), tuple(usable))
    return best


def fit_declared_model(
    prepared: Prepared, terms: list[ModelTerm], inertial: bool, blocks: list[Block]
) -> Regression:
    """Regression weighted by the residual scale of each joint."""
    sigma = np.array(
        [
            max(np.std(np.concatenate([r.measured[:, j] for r in prepared.runs_for("train")])), 1e-9)
            for j in range(prepared.n)
        ]
    )
    model = Regression(prepared, terms, sigma, inertial, blocks)
    for _ in range(ROUNDS):
        before = model.sigma
        model.weigh_by(residual_scale(model))
        if np.all(np.abs(model.sigma - before) <= SETTLED * before):
            break
    return model


def residual_scale(model: Regression) -> np.ndarray:
    """Root mean square residual of each joint over the rows that count."""
    residuals = model.residuals(model.solve())
    total = np.zeros(model.prepared.n)
    count = np.zeros(model.prepared.n)
    for r, w in zip(residuals, model.weights, strict=True):
        total += ((r * (w > 0)) ** 2).sum(axis=0)
        count += (w > 0).sum(axis=0)
    return np.sqrt(np.maximum(total / np.maximum(count, 1), 1e-18))
