"""Runs as rows: torques, weights and regressors, at the common bandwidth."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wearscope.closed_loop.intake.filtering import rows as band_rows
from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.effects.base import Signals
from wearscope.tracking.changes import Change
from wearscope.tracking.inference import SessionRows
from wearscope.tracking.structure import Structure

#: Length of a block in periods of the common cut-off, which bounds how fast the residual forgets; least [s].
_BLOCK_PERIODS, _SHORTEST = 4.0, 0.4
#: Share of its top speed above which a joint moves.
_MOVES = 0.01


@dataclass(eq=False)
class RunRows:
    """One run as rows: (M, n) rows of each joint, and regressors of them.

    Attributes
    ----------
    run : PreparedRun
    signals : Signals
        Along the run, with the healthy machine's torques.
    target : ndarray (M, n)
        Measured torque less the known one.
    weights : ndarray (M, n)
        Square root of each row's weight: zero where it does not count.
    columns : ndarray (M, n, width)
    unrecorded : ndarray (M, n, u)
    starts : ndarray (B,)
        First row of each block.
    """

    run: PreparedRun
    signals: Signals
    target: np.ndarray
    weights: np.ndarray
    columns: np.ndarray
    unrecorded: np.ndarray
    starts: np.ndarray


def make_rows(structure: Structure, run: PreparedRun) -> RunRows:
    """Rows of a run in the reference's structure."""
    signals = structure.operate(run)
    duration = float(run.t[-1] - run.t[0])
    length = max(_SHORTEST, _BLOCK_PERIODS / run.band.torque)
    count = max(2, round(duration / length))
    starts = np.unique(np.linspace(0, len(run.t), count + 1).astype(int)[:-1])
    return RunRows(
        run,
        signals,
        run.measured - run.reduce(run.known),
        run.keep / structure.scales.noise,
        reduce_columns(run, structure.columns(signals)),
        reduce_columns(run, structure.unrecorded_columns(signals)),
        starts,
    )


def hold_temperatures(structure: Structure, run: PreparedRun) -> PreparedRun:
    """The run as if its temperatures had kept within those of the reference."""
    low, high = (
        np.where(np.isfinite(x), x, y) for x, y in zip(structure.warmth, (-np.inf, np.inf), strict=True)
    )
    return replace(run, signals=replace(run.signals, temperature=np.clip(run.signals.temperature, low, high)))


def reduce_columns(run: PreparedRun, x: np.ndarray) -> np.ndarray:
    """Regressors (N, n, p) after the common filter, (M, n, p); there may be none."""
    return run.reduce(x) if x.size else np.zeros((len(run.t), *x.shape[1:]))


def stack_rows(structure: Structure, changes: Sequence[Change], runs: Sequence[RunRows]) -> SessionRows:
    """Rows of a session's runs."""
    target, base, unrecorded, columns, shares, starts = [], [], [], [], [], []
    first = 0
    for rows in runs:
        w, keep = rows.weights, rows.weights > 0
        parts = [reduce_columns(rows.run, change.columns(rows.signals)) for change in changes]
        scaled = []
        for change, x in zip(changes, parts, strict=True):
            size = structure.scales.friction if change.friction else structure.scales.torque
            taken, felt = (keep, x) if change.asked else feel_torque(structure, change, rows)
            scaled.append(
                felt * (taken / size)[:, :, None] / np.sqrt(max(float(taken.sum(axis=0).max()), 1.0))
            )
        columns.append(_flatten(np.concatenate(parts, axis=2) * w[:, :, None]))
        shares.append(_flatten(np.concatenate(scaled, axis=2)))
        target.append((rows.target * w).ravel())
        base.append(_flatten(rows.columns * w[:, :, None]))
        unrecorded.append(_flatten(rows.unrecorded * w[:, :, None]))
        starts.append(first + rows.starts * structure.n)
        first += w.size
    together = [np.concatenate(x) for x in (target, base, unrecorded, columns, shares, starts)]
    together[4] /= np.sqrt(len(runs))
    return SessionRows(*together)


def feel_torque(structure: Structure, change: Change, rows: RunRows) -> tuple[np.ndarray, np.ndarray]:
    """Rows (M, n) in which a joint moves, and regressors (M, n, m) there before the common filter.

    A joint feels a bump at low speed in full, however briefly; the filter leaves little of it.
    """
    at = band_rows(rows.run.band, len(rows.signals.t))
    moves = np.abs(rows.signals.v[at]) > _MOVES * np.maximum(structure.frame.top_speed, 1e-12)
    return moves, change.columns(rows.signals)[at]


def _flatten(x: np.ndarray) -> np.ndarray:
    return x.reshape(x.shape[0] * x.shape[1], x.shape[2])
