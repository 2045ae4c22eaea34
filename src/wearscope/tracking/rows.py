"""Rows of runs at the common bandwidth: torques, weights and regressors."""

from dataclasses import dataclass, replace

import numpy as np

from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.effects.base import Signals
from wearscope.tracking.structure import Structure

#: Length of a block in periods of the common cut-off, since the filter correlates nearer samples; its least
#: length [s].
_BLOCK_PERIODS, _SHORTEST = 4.0, 0.4
#: Speed over which friction at low speed dies away, as a share of the joint's top speed.
_SLOW = 0.05


@dataclass(eq=False)
class RunRows:
    """Rows of one run, with their regressors.

    Attributes
    ----------
    run : PreparedRun
    signals : Signals
        Signals of the run, with the healthy machine's torques of motors and gears.
    target : ndarray (M, n)
        Measured torque less the known one.
    weights : ndarray (M, n)
        Square root of each row's weight; zero where it does not count.
    columns : ndarray (M, n, width)
        Regressors of the structure.
    unrecorded : ndarray (M, n, u)
        Regressors of temperatures that were not recorded.
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
        run.reduce_columns(structure.columns(signals)),
        run.reduce_columns(structure.unrecorded_columns(signals)),
        starts,
    )


def hold_temperatures(structure: Structure, run: PreparedRun) -> PreparedRun:
    """The run with its temperatures shifted so that their means lie within the reference's range."""
    low, high = (
        np.where(np.isfinite(x), x, y) for x, y in zip(structure.warmth, (-np.inf, np.inf), strict=True)
    )
    warmth = run.signals.temperature
    mean = warmth.mean(axis=0)
    return replace(run, signals=replace(run.signals, temperature=warmth + np.clip(mean, low, high) - mean))


def scatter_columns(structure: Structure, rows: RunRows) -> np.ndarray:
    """Regressors (M, n, 5 m) of the differences between healthy sessions.

    There are five for each of the m joints that move: Coulomb friction, viscous friction, friction at low
    speed, the torque's factor, and its level. The weights of the first three are shares of the joint's RMS
    friction; those of the others are shares of its torque.
    """
    s, parts = rows.signals, []
    for j in map(int, structure.moving):
        coulomb, viscous = structure.friction_columns(s, j)
        slow = coulomb * np.exp(-np.abs(s.v[:, j]) / (_SLOW * structure.frame.top_speed[j]))
        level = np.full(len(s.t), structure.scales.torque[j])
        own = np.column_stack([coulomb, viscous, slow, np.asarray(s.torque)[:, j], level])
        parts.append(structure.place(j, own))
    return rows.run.reduce_columns(np.concatenate(parts, axis=2))
