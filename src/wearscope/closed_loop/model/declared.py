"""The declared model: entries of the declared effects, fitted with the scale of what they leave."""

import numpy as np

from wearscope.closed_loop.model.candidates import applies, joined_signals
from wearscope.closed_loop.intake.preprocessing import Prepared
from wearscope.closed_loop.model.regression import Entry, Regression
from wearscope.effects.base import load_effect


def declared_entries(prepared: Prepared) -> list[Entry]:
    """Entries of the declared effects that have parameters to fit."""
    fields = prepared.dataset.fields
    entries = []
    joined = joined_signals(prepared.runs_for("train"))
    for name in fields.declared_effects:
        if name == "rigid_body" or (name == "rotor_inertia" and fields.robot.rotor_inertia is not None):
            continue
        effect = load_effect(name)
        for joint in range(prepared.n):
            if not applies(effect, joint, prepared):
                continue
            shapes = effect.shapes(joined, joint)
            subset = effect.subsets()[-1]
            entries.append(
                Entry(effect, joint, tuple(shapes[len(shapes) // 2]), tuple(int(i) for i in subset))
            )
    return entries


def fit_scale(prepared: Prepared, entries: list[Entry], inertial: bool, blocks: list) -> Regression:
    """Regression weighted by the residual scale of each joint."""
    sigma = np.array(
        [
            max(np.std(np.concatenate([r.measured[:, j] for r in prepared.runs_for("train")])), 1e-9)
            for j in range(prepared.n)
        ]
    )
    for _ in range(2):
        model = Regression(prepared, entries, sigma, inertial, blocks)
        sigma = residual_scale(model)
    return Regression(prepared, entries, sigma, inertial, blocks)


def residual_scale(model: Regression) -> np.ndarray:
    """Root mean square residual of each joint over the rows that count."""
    residuals = model.residuals(model.solve())
    total = np.zeros(model.prepared.n)
    count = np.zeros(model.prepared.n)
    for r, w in zip(residuals, model.weights, strict=True):
        total += ((r * (w > 0)) ** 2).sum(axis=0)
        count += (w > 0).sum(axis=0)
    return np.sqrt(np.maximum(total / np.maximum(count, 1), 1e-18))
