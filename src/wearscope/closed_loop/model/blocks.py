"""Blocks of the training runs: what is resampled, held out and must agree."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from wearscope.closed_loop.intake.preprocessing import Prepared

#: Length of a block in periods of the common cut-off, which bounds how fast the residual forgets.
_BLOCK_PERIODS = 4.0


@dataclass(frozen=True)
class Block:
    """Rows `start` to `stop` of training run `run`."""

    run: int
    start: int
    stop: int


@dataclass
class Folds:
    """Cross-validation and the parts that must agree.

    Attributes
    ----------
    train, test : ndarray (F, B) of bool
        For each fold the blocks trained on and the blocks held out.
    by_run : bool
        Whether whole runs are held out.
    parts : ndarray (B,) of int
        Part of each block: its run where there are three or more, else a contiguous part of it.
    agree_by_run : bool
        Whether parts are whole runs.
    """

    train: np.ndarray
    test: np.ndarray
    by_run: bool
    parts: np.ndarray
    agree_by_run: bool


def make_blocks(prepared: Prepared) -> list[Block]:
    """Contiguous blocks of the training runs, long against the correlation of the residual."""
    runs = prepared.runs_for("train")
    length = max(0.4, _BLOCK_PERIODS / prepared.band.torque)
    blocks = []
    for r, run in enumerate(runs):
        count = max(2, round((run.t[-1] - run.t[0]) / length))
        edges = np.linspace(0, len(run.t), count + 1).astype(int)
        blocks += [Block(r, a, b) for a, b in pairwise(edges)]
    return blocks


def make_folds(blocks: list[Block]) -> Folds:
    """Whole runs held out in turn; of a single run, contiguous fifths with a block's gap on either side."""
    run_of = np.array([block.run for block in blocks])
    runs = run_of.max() + 1
    share = {1: 5, 2: 4}.get(runs, 1)
    parts = np.empty(len(blocks), dtype=int)
    for r in range(runs):
        own = np.flatnonzero(run_of == r)
        parts[own] = share * r + np.arange(len(own)) * share // len(own)
    if runs > 1:
        test = np.array([run_of == r for r in range(runs)])
        return Folds(~test, test, True, parts, runs > 2)
    test = np.array([parts == k for k in range(share)])
    near = test.copy()
    near[:, 1:] |= test[:, :-1]
    near[:, :-1] |= test[:, 1:]
    return Folds(~near, test, False, parts, False)
