"""Rows of all training runs, their blocks, and the stretches that folds are fitted on and hold out."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from wearscope.closed_loop.intake.design_effect import JoinedBlocks
from wearscope.closed_loop.intake.filtering import rows
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.model.blocks import Block, Folds, hold_out_fifths, make_blocks, make_folds


def measure_motion(run: PreparedRun, start: int, stop: int) -> np.ndarray:
    """Path (n,) of every joint over some rows of a run that count."""
    at = rows(run.band, len(run.signals.t))
    speed = np.abs(run.signals.v[at][start:stop])
    return np.asarray((speed * run.keep[start:stop]).sum(axis=0))


@dataclass(frozen=True)
class Units:
    """Rows that the same folds are fitted on and hold out.

    Attributes
    ----------
    train, test : ndarray (F, U)
        1 where a fold is fitted on a unit, and where it holds it out.
    of_row : ndarray (M,) of int
        Unit of each row.
    """

    train: np.ndarray
    test: np.ndarray
    of_row: np.ndarray

    @property
    def count(self) -> int:
        """Number of units."""
        return self.train.shape[1]

    @cached_property
    def segments(self) -> list[tuple[int, slice]]:
        """Unit and rows of each stretch."""
        edges = np.concatenate([[0], 1 + np.flatnonzero(np.diff(self.of_row)), [len(self.of_row)]])
        return [(int(self.of_row[a]), slice(a, b)) for a, b in pairwise(edges.tolist())]

    @cached_property
    def test_rows(self) -> list[np.ndarray]:
        """Rows that each fold holds out."""
        return [np.flatnonzero(own[self.of_row]) for own in self.test]


@dataclass(frozen=True)
class Layout:
    """Blocks, folds and rows of the training runs.

    Attributes
    ----------
    prepared : Prepared
    blocks : list of Block
    folds : Folds
    """

    prepared: Prepared
    blocks: list[Block]
    folds: Folds

    @classmethod
    def of(cls, prepared: Prepared) -> "Layout":
        """Layout of a prepared data set."""
        blocks, train = make_blocks(prepared), prepared.runs_for("train")
        motion = np.array([measure_motion(train[b.run], b.start, b.stop) for b in blocks])
        return cls(prepared, blocks, make_folds(blocks, [run.file for run in train], motion))

    @cached_property
    def block_of(self) -> np.ndarray:
        """Block of each row, (M,)."""
        return np.repeat(np.arange(len(self.blocks)), [block.stop - block.start for block in self.blocks])

    @cached_property
    def _starts(self) -> np.ndarray:
        return np.searchsorted(self.block_of, np.arange(len(self.blocks)))

    @cached_property
    def units(self) -> Units:
        """Units of the folds."""
        member = np.concatenate([self.folds.train, self.folds.test])
        patterns, unit = np.unique(member, axis=1, return_inverse=True)
        train, test = np.split(patterns.astype(float), 2)
        return Units(train, test, unit.reshape(-1)[self.block_of])

    @cached_property
    def by_fifths(self) -> "Layout":
        """Units of a layout with fifths of every recording held out."""
        other = Layout(self.prepared, self.blocks, hold_out_fifths(self.blocks, self.folds))
        other.__dict__.update(keep=self.keep, run_of=self.run_of, by_fifths=other)
        return other

    @cached_property
    def run_of(self) -> np.ndarray:
        """Run of each block, (B,)."""
        return np.array([block.run for block in self.blocks])

    @cached_property
    def keep(self) -> np.ndarray:
        """Rows that count by joint, (M, n)."""
        return np.concatenate([run.keep for run in self.prepared.runs_for("train")])

    @cached_property
    def torque_size(self) -> np.ndarray:
        """RMS (2, n) of each joint's measured torque in rows that count, and about its mean in each run."""
        runs = self.prepared.runs_for("train")
        squares = np.zeros((2, self.prepared.n))
        for run, keep in zip(runs, self.unpack(self.keep), strict=True):
            count = np.maximum(keep.sum(axis=0), 1)
            mean = (run.measured * keep).sum(axis=0) / count
            squares += [(x**2 * keep).sum(axis=0) for x in (run.measured, run.measured - mean)]
        return np.sqrt(np.maximum(squares / np.maximum(self.keep.sum(axis=0), 1), 1e-300))

    def restrict(self, joint: int, rows: np.ndarray) -> "Layout":
        """The same with only some of a joint's rows (M,) counting."""
        other = Layout(self.prepared, self.blocks, self.folds)
        keep = self.keep.copy()
        keep[:, joint] &= rows
        other.__dict__["keep"] = keep
        return other

    @cached_property
    def joined(self) -> JoinedBlocks:
        """The blocks, joined within their runs."""
        return JoinedBlocks(self._starts, self.run_of)

    def sum_blocks(self, x: np.ndarray) -> np.ndarray:
        """Sums (B, ...) of rows (M, ...) by block."""
        return np.asarray(np.add.reduceat(x, self._starts, axis=0))

    def unpack(self, x: np.ndarray) -> list[np.ndarray]:
        """Rows (M, ...) as one array a run."""
        lengths = [len(run.t) for run in self.prepared.runs_for("train")]
        return np.split(x, np.cumsum(lengths)[:-1])
