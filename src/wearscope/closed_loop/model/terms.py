"""Terms of a model, an effect at a joint with its shape and coefficients, and candidates for them.

A candidate is an effect at a joint with all shapes worth trying, as rows of regressors.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from wearscope.closed_loop.intake.filtering import low_pass
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.intake.threads import map_runs
from wearscope.closed_loop.model.inertials import find_penalty
from wearscope.effects.base import Effect, MeasurementEffect, Signals, TransmissionEffect


@dataclass(frozen=True)
class ModelTerm:
    """An effect at a joint with its shape, some of its coefficients in use.

    Attributes
    ----------
    effect : Effect
    joint : int
    shape : tuple of float
    subset : tuple of int
        Indices of the coefficients in use.
    """

    effect: Effect
    joint: int
    shape: tuple[float, ...]
    subset: tuple[int, ...]

    @property
    def label(self) -> str:
        """Name and joint index."""
        return f"{self.effect.name}@{self.joint}"

    @property
    def is_measurement_error(self) -> bool:
        """Whether the term is an error of the torque sensor, which acts on the rest of the model's torque."""
        return isinstance(self.effect, MeasurementEffect)

    @property
    def is_deflection(self) -> bool:
        """Whether the term is a deflection of a gear."""
        return isinstance(self.effect, TransmissionEffect)

    def columns(self, signals: Signals) -> np.ndarray:
        """Full-rate regressors at every joint, (N, n, m)."""
        x = self.effect.columns(signals, self.joint, np.array(self.shape))[..., list(self.subset)]
        if self.effect.spread:
            return x
        full = np.zeros((len(x), signals.q.shape[1], x.shape[-1]))
        full[:, self.joint] = x
        return full


#: Number of columns made at once: full-rate regressors of many shapes then need little memory.
_AT_ONCE = 64


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect at one joint with all shapes worth trying.

    Attributes
    ----------
    effect : Effect
    joint : int
    shapes : tuple of tuple of float
        Shape of the model term of each alternative.
    joints : tuple of int
        Joints at which the effect acts.
    rows : sequence of ndarray (M, S*m)
        For each joint of `joints`, the filtered regressors of all training runs, stacked.
    penalty : ndarray (m, m) or None
        Prior precision of the coefficients.
    tried : float
        Number of shapes from which each of `shapes` was chosen, by which the score corrects for chance.
    """

    effect: Effect
    joint: int
    shapes: tuple[tuple[float, ...], ...]
    joints: tuple[int, ...]
    rows: Sequence[np.ndarray]
    penalty: np.ndarray | None = None
    tried: float = 1.0

    @property
    def count(self) -> int:
        """Number of columns of each shape."""
        return self.rows[0].shape[1] // len(self.shapes)

    def at(self, shape: int) -> "Candidate":
        """The candidate with one shape only."""
        if len(self.shapes) == 1:
            return self
        own = slice(shape * self.count, (shape + 1) * self.count)
        return replace(self, shapes=(self.shapes[shape],), rows=tuple(x[:, own] for x in self.rows))

    def term(self, shape: int, subset: tuple[int, ...]) -> ModelTerm:
        """Model term of one shape and subset."""
        return ModelTerm(self.effect, self.joint, self.shapes[shape], subset)


def reduce_columns(
    effect: Effect, joint: int, shapes: np.ndarray, run: PreparedRun, signals: Signals | None = None
) -> np.ndarray:
    """Filtered regressors of all shapes along one run: (M, S*m), or (M, n, S*m) of an effect at all joints.

    Parameters
    ----------
    effect : Effect
    joint : int
    shapes : ndarray (S, k)
    run : PreparedRun
    signals : Signals, optional
        Signals to take instead of the run's own.
    """
    own = run.signals if signals is None else signals
    step = max(1, _AT_ONCE // max(len(effect.coefficients), 1))
    chunks = [
        run.reduce_columns(
            effect.stack(own, joint, shapes[start : start + step]), None if effect.spread else joint
        )
        for start in range(0, len(shapes), step)
    ]
    return np.concatenate(chunks, axis=-1)


def make_candidate(effect: Effect, joint: int, prepared: Prepared, shapes: np.ndarray) -> Candidate:
    """Candidate of an effect at a joint with given shapes (S, k), from the motion alone.

    A gear bends under the rigid body's torque along the motion, low-pass filtered, since two derivatives
    would amplify its noise.
    """
    train = prepared.runs_for("train")
    signals = [run.signals for run in train]
    if isinstance(effect, TransmissionEffect):
        edge = float(prepared.lost_motion_cutoff[joint]) if effect.abrupt else prepared.band.gear
        signals = [
            replace(run.signals, transmitted=low_pass(run.signals.load, edge, run.band.rate)) for run in train
        ]
    parts = map_runs(partial(reduce_columns, effect, joint, shapes), train, signals)
    named = tuple(tuple(float(x) for x in shape) for shape in shapes)
    stacked = np.concatenate(parts)
    if not effect.spread:
        return Candidate(effect, joint, named, (joint,), (stacked,))
    felt = tuple(j for j in range(prepared.n) if prepared.moving[j] and np.any(stacked[:, j]))
    rows = tuple(np.ascontiguousarray(stacked[:, j]) for j in felt)
    return Candidate(effect, joint, named, felt, rows, find_penalty(prepared, effect))
