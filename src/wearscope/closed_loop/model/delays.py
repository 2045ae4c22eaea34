"""Declared delays of the torque channels: each is searched as a shift, and its channel is moved by it.

A torque that is recorded late by d is the motor torque at t - d. Along a motion of several hertz it is far
from linear in a delay of tens of milliseconds, so a derivative is not enough. All other coefficients of a
joint are projected out at every delay of a grid, and the best one is refined (variable projection, Golub and
Pereyra 1973). The remaining delay is a small part of a sample, for which a linear term suffices.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy import interpolate, optimize

from wearscope.closed_loop.intake.dataset import Dataset
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.intake.recording import Run
from wearscope.closed_loop.intake.thinning import Budget, prepare_thinned
from wearscope.closed_loop.model.prediction import refit
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm

#: Longest delay that is searched, in s and as a share of the shortest run; grid steps in a period of the
#: cut-off.
_LONGEST, _SHARE, _STEPS = 0.25, 0.1, 40.0
#: Largest number of rows of a joint that are used.
_MOST_ROWS = 20_000
#: Share of the variance that one delay of all channels leaves and a channel's own must remove: less is a
#: tenth of the RMS error.
_OWN = 0.2


def find_delays(model: Regression, joints: Sequence[int]) -> np.ndarray:
    """Delay (n,) [s] of each torque channel with the smallest residual; zero at the other joints.

    One recorder has one delay, which the joints tell together: a slow joint alone tells it poorly. A channel
    has another delay where that leaves clearly less.

    Parameters
    ----------
    model : Regression
        The declared model without delays.
    joints : sequence of int
        Joints whose channel may be late.
    """
    delays = np.zeros(model.prepared.n)
    misses = {j: miss for j in joints if (miss := _weigh_delays(model, j)) is not None}
    delays[list(joints)] = one = _find_least(model, list(misses.values()))
    for j, miss in misses.items():
        own = _find_least(model, [miss])
        if miss(own) < (1.0 - _OWN) * miss(one):
            delays[j] = own
    return delays


def _find_longest(model: Regression) -> float:
    """Longest delay that is searched [s]."""
    train = model.prepared.runs_for("train")
    return min(_LONGEST, _SHARE * min(float(run.t[-1] - run.t[0]) for run in train))


def _find_least(model: Regression, misses: Sequence[Callable[[float], float]]) -> float:
    """Delay [s] at which the joints' residuals together are smallest."""
    if not misses:
        return 0.0
    longest = _find_longest(model)

    def miss(delay: float) -> float:
        return sum(np.log(max(one(delay), 1e-300)) for one in misses)

    step = 1.0 / (_STEPS * model.prepared.band.torque)
    grid = step * np.arange(-int(longest / step), int(longest / step) + 1)
    best = float(grid[int(np.argmin([miss(d) for d in grid]))])
    low, high = max(best - step, -longest), min(best + step, longest)
    return float(optimize.minimize_scalar(miss, bounds=(low, high), method="bounded").x)


def _weigh_delays(model: Regression, joint: int) -> Callable[[float], float] | None:
    """Residual share of a joint's torque as a function of its channel's shift; None with too few rows."""
    prepared = model.prepared
    train, longest = prepared.runs_for("train"), _find_longest(model)
    every = max(1, sum(len(run.t) for run in train) // _MOST_ROWS)
    columns, parts = [], []
    for run, x in zip(train, model.columns, strict=True):
        known = run.reduce(run.known[:, [joint]])
        # The rigid body's factor is free, as its masses may be wrong.
        inside = (run.t >= run.t[0] + longest) & (run.t <= run.t[-1] - longest)
        at = np.flatnonzero(run.keep[:, joint] & inside)[::every]
        columns.append(np.column_stack([x[at, joint], known[at], np.ones(len(at))]))
        parts.append((interpolate.CubicSpline(run.t, run.measured[:, joint]), run.t[at]))
    stacked = np.concatenate(columns)
    if len(stacked) <= 2 * stacked.shape[1]:
        return None
    basis, sizes, _ = np.linalg.svd(
        stacked / np.maximum(np.abs(stacked).max(axis=0), 1e-12), full_matrices=False
    )
    basis = basis[:, sizes > 1e-8 * sizes[0]]

    def miss(delay: float) -> float:
        y = np.concatenate([torque(t + delay) for torque, t in parts])
        return float(y @ y - np.sum((basis.T @ y) ** 2)) / float(y @ y)

    return miss


def move_torque(dataset: Dataset, delays: np.ndarray) -> Dataset:
    """The data set with each torque channel moved back by its delay (n,) [s], also by fractions of a sample.

    Rows at the ends of a recording that have no torque after the move are left out.
    """
    told = ", ".join(
        f"{joint} {1000 * d:.1f} ms" for joint, d in zip(dataset.joints, delays.tolist(), strict=True) if d
    )
    runs = [replace(record, load=partial(_load_moved, record.load, delays)) for record in dataset.runs]
    notes = [*dataset.notes, f"torque channels are moved by their delays: {told}"]
    return replace(dataset, runs=runs, notes=notes, delays=tuple(delays.tolist()))


def move_by_delays(model: Regression, joints: Sequence[int], budget: Budget | None = None) -> Prepared:
    """The data set prepared again, the torque channels of some joints moved by their delays.

    Parameters
    ----------
    model : Regression
        The data set's model without delays.
    joints : sequence of int
    budget : Budget, optional
        How much of the runs is used.
    """
    prepared = model.prepared
    able = [j for j in joints if prepared.moving[j]]
    delays = find_delays(model, able)
    moved = prepare_thinned(move_torque(prepared.dataset, delays), budget)
    kept = {name: getattr(prepared, name) for name in ("link_side", "torque_factors", "noted", "checked")}
    return replace(moved, notes=[*moved.notes, *prepared.checked], **kept)


def _load_moved(load: Callable[[], Run], delays: np.ndarray) -> Run:
    run = load()
    tau = np.column_stack(
        [
            interpolate.CubicSpline(run.t, x)(run.t + d) if d else x
            for x, d in zip(run.tau.T, delays, strict=True)
        ]
    )
    inside = (run.t + delays.min() >= run.t[0]) & (run.t + delays.max() <= run.t[-1])
    at = np.flatnonzero(inside)
    return replace(run, tau=tau).cut(int(at[0]), int(at[-1]) + 1)


def undo_shifts(model: Regression, terms: Sequence[ModelTerm]) -> Regression:
    """Model of moved channels, refitted with the total delay of some terms at zero, as if never moved."""
    known = {
        k: np.array([-find_shift(model.prepared, term.joint)])
        for k, term in enumerate(model.entries)
        if any(term is one for one in terms)
    }
    return refit(model, model.entries, known) if known else model


def find_shift(prepared: Prepared, joint: int) -> float:
    """Delay [s] by which a joint's torque channel was moved."""
    return prepared.dataset.delays[joint] if prepared.dataset.delays else 0.0
