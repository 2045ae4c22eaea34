"""Rows of all training runs arranged by block, so that every sum over a block is one product of arrays."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wearscope.closed_loop.intake.filtering import rows
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.model.blocks import Block, Folds, hold_out_fifths, make_blocks, make_folds


def measure_motion(run: PreparedRun, start: int, stop: int) -> np.ndarray:
    """Path (n,) of every joint over some rows of a run that count."""
    at = rows(run.band, len(run.signals.t))
    speed = np.abs(run.signals.v[at][start:stop])
    return np.asarray((speed * run.keep[start:stop]).sum(axis=0))


@dataclass(frozen=True)
class Products:
    """Block sums of products of a term's columns at one joint, not weighed.

    Attributes
    ----------
    owner : tuple
        The candidate, the subset and the target that they are of.
    x : ndarray (B, L, m)
        Its columns at the rows that count.
    gram : ndarray (B, m, m)
    score : ndarray (B, m)
    """

    owner: tuple
    x: np.ndarray
    gram: np.ndarray
    score: np.ndarray

    def is_of(self, owner: tuple) -> bool:
        """Whether they are of the same objects."""
        return all(
            a is b or (isinstance(a, tuple) and a == b) for a, b in zip(self.owner, owner, strict=True)
        )


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
    def index(self) -> np.ndarray:
        """Row of each place (B, L); the number of rows, which holds zeros, where a block has fewer."""
        lengths = [len(run.t) for run in self.prepared.runs_for("train")]
        first = np.concatenate([[0], np.cumsum(lengths)])
        longest = max(block.stop - block.start for block in self.blocks)
        index = np.full((len(self.blocks), longest), int(first[-1]))
        for b, block in enumerate(self.blocks):
            index[b, : block.stop - block.start] = first[block.run] + np.arange(block.start, block.stop)
        return index

    @cached_property
    def by_fifths(self) -> "Layout":
        """The same with fifths of every recording held out."""
        other = Layout(self.prepared, self.blocks, hold_out_fifths(self.blocks, self.folds))
        other.__dict__.update(index=self.index, keep=self.keep, run_of=self.run_of, by_fifths=other)
        other.__dict__["first_terms"] = self.first_terms
        return other

    @property
    def for_standard(self) -> "Layout":
        """The same as standard terms are asked about: by fifths where there are two recordings.

        Each has a motion of its own, and fitted on one alone a model may lack what only the other shows.
        """
        return self.by_fifths if len(np.unique(self.folds.recording)) == 2 else self

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
    def first_terms(self) -> dict[int, "Products"]:
        """Products of the first term of the model that was last asked about, by joint."""
        return {}

    def pack(self, x: np.ndarray) -> np.ndarray:
        """Rows (M, ...) as (B, L, ...), zero beyond a block's end."""
        padded = np.concatenate([x, np.zeros((1, *x.shape[1:]))])
        return padded[self.index]

    def unpack(self, x: np.ndarray) -> list[np.ndarray]:
        """Rows (M, ...) as one array a run."""
        lengths = [len(run.t) for run in self.prepared.runs_for("train")]
        return np.split(x, np.cumsum(lengths)[:-1])
