"""Friction's reversal beside a model: over which speed each joint's direction of motion changes.

The width that the rough model gave is one of a poorer model. Beside the terms that the search has found it is
fitted again, and what is left of its error is a column of its own in every model that candidates are weighed
beside, so that no name is given for a reversal that is a little sharper or smoother than assumed.
"""

from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.intake.preprocessing import Prepared
from wearscope.closed_loop.model.candidates import reduce_columns
from wearscope.closed_loop.selection.assembly import Assembly, Chosen
from wearscope.effects.base import Effect, MeasurementEffect, Parameter, RigidBodyEffect, Signals

#: Step of the logarithm of a width for its derivative; steps taken; largest one; smallest one worth taking.
_DIFFERENCE, _STEPS, _FURTHEST, _NEAREST = 0.02, 5, 0.5, 0.003
#: Least and largest width, over the joint's largest speed.
_LEAST, _LARGEST = 1e-4, 0.3
#: Standard errors that a change of a width must have.
_ERRORS = 1.0


def _take_reversal(signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
    assert signals.reversal is not None
    return signals.reversal[:, [joint]]


REVERSAL = Effect(
    name="reversal",
    form="level d sign(v) / d ln(width)",
    coefficients=(Parameter("level", "{torque}"),),
    source="first-order error of the width of the friction's reversal",
    depends_on=("qd_{joint}",),
    regressors=_take_reversal,
    candidate=False,
)
"""What a small error of the reversal's width leaves of Coulomb friction; never named."""


@dataclass(frozen=True)
class _JointFit:
    """Least squares of one joint's torque on its own terms, and the step of its width that would do better."""

    loss: float
    step: float
    error: float


def refine_widths(prepared: Prepared, assembly: Assembly) -> np.ndarray:
    """Widths (n,) of the reversals with which a model fits the training runs best (Gauss-Newton).

    Parameters
    ----------
    prepared : Prepared
    assembly : Assembly
        The model.

    Returns
    -------
    ndarray
        Unchanged where nothing in the model changes its sign with the motion, and for reversals at once.
    """
    widths = prepared.reversal_width.copy()
    frictions = {j: _list_own(assembly.chosen, j) for j in np.flatnonzero(widths > 0.0).tolist()}
    frictions = {j: terms for j, terms in frictions.items() if terms}
    if not frictions:
        return widths
    top = np.max([np.abs(run.signals.v).max(axis=0) for run in prepared.runs_for("train")], axis=0)
    best = {j: (np.inf, widths[j]) for j in frictions}
    moving = set(frictions)
    for _ in range(_STEPS + 1):
        fits = _fit_joints(prepared.reverse_over(widths), assembly, {j: frictions[j] for j in moving})
        for j, fit in fits.items():
            if not fit.loss < best[j][0]:
                # Half way back to what was better.
                if np.isfinite(best[j][0]) and abs(np.log(widths[j] / best[j][1])) > 2.0 * _NEAREST:
                    widths[j] = np.sqrt(widths[j] * best[j][1])
                else:
                    moving.discard(j)
                continue
            best[j] = (fit.loss, widths[j])
            if abs(fit.step) < max(_NEAREST, _ERRORS * fit.error):
                moving.discard(j)
                continue
            changed = widths[j] * np.exp(np.clip(fit.step, -_FURTHEST, _FURTHEST))
            widths[j] = float(np.clip(changed, _LEAST * top[j], _LARGEST * top[j]))
        if not moving:
            break
    for j, (_, width) in best.items():
        widths[j] = width
    return widths


def _list_own(chosen: tuple[Chosen, ...], joint: int) -> list[int]:
    """Indices of a model's terms that act at one joint alone and are evaluated along its motion."""
    return [
        k
        for k, c in enumerate(chosen)
        if c.candidate.joint == joint
        and c.candidate.effect is not REVERSAL
        and not (c.candidate.effect.spread or isinstance(c.candidate.effect, (MeasurementEffect, RigidBodyEffect)))
    ]


def _fit_joints(prepared: Prepared, assembly: Assembly, own: dict[int, list[int]]) -> dict[int, _JointFit]:
    """Fit each joint's own terms along signals, and the change of its width, the terms of others held."""
    train = prepared.runs_for("train")
    moved = prepared.reverse_over(prepared.reversal_width * np.exp(_DIFFERENCE)).runs_for("train")
    fits = {}
    for j, terms in own.items():
        here, there = [], []
        for k in terms:
            c = assembly.chosen[k]
            shape, pick = np.array(c.candidate.shapes), list(c.subset)
            here.append(_stack([reduce_columns(c.candidate.effect, j, shape, run) for run in train])[:, pick])
            there.append(_stack([reduce_columns(c.candidate.effect, j, shape, run) for run in moved])[:, pick])
        x, other = np.concatenate(here, axis=1), np.concatenate(there, axis=1)
        keep = assembly.layout.keep[:, j]
        columns = np.concatenate([np.arange(s.start, s.stop) for s in (assembly.spans[k] for k in terms)])
        mask = np.isin(assembly.at[j], columns)
        others = np.array([k for k in assembly.at[j] if not mask[list(assembly.at[j]).index(k)]], dtype=int)
        reversal = _reversal_columns(assembly, j)
        held = [k for k in others if k not in reversal]
        y = assembly.target[:, j] - assembly.columns[j][:, np.isin(assembly.at[j], held)] @ assembly.theta[held]
        x, other, y = x[keep], other[keep], y[keep]
        theta, left = _solve(x, y)
        slope = (other - x) @ theta / _DIFFERENCE
        both, after = _solve(np.column_stack([x, slope]), y)
        free = slope - x @ _solve(x, slope)[0]
        power = float(free @ free)
        if power <= 1e-12 * float(slope @ slope) or power == 0.0:
            fits[j] = _JointFit(left, 0.0, np.inf)
            continue
        fits[j] = _JointFit(left, float(both[-1]), float(np.sqrt(after / max(len(y), 1) / power)))
    return fits


def _reversal_columns(assembly: Assembly, joint: int) -> set[int]:
    return {
        k
        for c, s in zip(assembly.chosen, assembly.spans, strict=True)
        if c.candidate.effect is REVERSAL and c.candidate.joint == joint
        for k in range(s.start, s.stop)
    }


def _stack(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate(parts)


def _solve(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, float]:
    """Least squares, and the sum of squares that it leaves."""
    scale = np.sqrt(np.maximum((x**2).sum(axis=0), 1e-300))
    theta = np.linalg.lstsq(x / scale, y, rcond=1e-10)[0] / scale
    return theta, float(((y - x @ theta) ** 2).sum())
