"""Blocks of the training runs: the units that are resampled, held out and compared with each other."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from wearscope.closed_loop.intake.prepared import Prepared

#: Length of a block in periods of the common cut-off, which bounds how fast autocorrelation decays.
_BLOCK_PERIODS = 4.0
#: Shortest block [s]; largest numbers of blocks and of folds.
_SHORTEST, _MOST_BLOCKS, _MOST_FOLDS = 0.4, 400, 10
#: Number of parts of a recording that is held out in parts.
_FIFTHS = 5
#: For a single run: number of parts in which a joint should move; share of an even spread of its motion from
#: which it counts as moving in a part; shortest stretch [blocks].
_ENOUGH, _MOVES_IN, _SHORTEST_STRETCH = 4, 0.25, 2


@dataclass(frozen=True)
class Block:
    """Rows `start` to `stop` of training run `run`."""

    run: int
    start: int
    stop: int


@dataclass
class Folds:
    """Cross-validation folds, and the parts between which a fit must agree.

    Attributes
    ----------
    train, test : ndarray (F, B) of bool
        For each fold the blocks trained on and the blocks held out.
    by_run : bool
        Whether whole runs are held out.
    parts : ndarray (B,) of int
        Part of each block: its run where there are three or more, else a contiguous part of it.
    recording : ndarray (B,) of int
        Recording of each block.
    """

    train: np.ndarray
    test: np.ndarray
    by_run: bool
    parts: np.ndarray
    recording: np.ndarray


def make_blocks(prepared: Prepared) -> list[Block]:
    """Contiguous blocks of the training runs, much longer than the residual's autocorrelation.

    There are at most `_MOST_BLOCKS` blocks, or two per run, so that cost stays linear in the rows.
    """
    runs = prepared.runs_for("train")
    whole = sum(run.t[-1] - run.t[0] for run in runs)
    length = max(_SHORTEST, _BLOCK_PERIODS / prepared.band.torque, whole / _MOST_BLOCKS)
    blocks = []
    for r, run in enumerate(runs):
        count = max(2, round((run.t[-1] - run.t[0]) / length))
        edges = np.unique(np.linspace(0, len(run.t), count + 1).astype(int))
        blocks += [Block(r, a, b) for a, b in pairwise(edges)]
    return blocks


def make_folds(blocks: list[Block], files: list[str], motion: np.ndarray | None = None) -> Folds:
    """Folds of whole runs in turn, or of contiguous fifths of a single run, a block apart from the rest.

    Where the joints of a single run move one after the other, one contiguous fifth could hold all motion of a
    joint. Each fifth then consists of several stretches, as few as let every joint move in enough fifths.

    Parameters
    ----------
    blocks : list of Block
    files : list of str
        File of each training run: pieces of one recording are held out together. With more than
        `_MOST_FOLDS` recordings, several are held out at once.
    motion : ndarray (B, n), optional
        How much of each joint's motion lies in each block.
    """
    unit = np.unique(files, return_inverse=True)[1][[block.run for block in blocks]]
    runs = int(unit.max()) + 1
    share = {1: _FIFTHS, 2: 4}.get(runs, 1)
    parts = _cut(unit, share)
    if runs == 1 and motion is not None:
        parts = _spread_parts(motion, share)
    if runs > 1:
        folds = min(runs, _MOST_FOLDS)
        test = np.array([unit * folds // runs == k for k in range(folds)])
        return Folds(~test, test, True, parts, unit)
    test = np.array([parts == k for k in range(share)])
    return Folds(_leave_gaps(test, np.ones(len(blocks) - 1, dtype=bool)), test, False, parts, unit)


def hold_out_fifths(blocks: list[Block], folds: Folds) -> Folds:
    """Folds that hold out one fifth of every recording at a time, a block apart from the rest.

    They are used for effects that need not be shown along another motion, or that only one recording shows.
    """
    parts = _cut(folds.recording, _FIFTHS)
    test = np.array([parts % _FIFTHS == k for k in range(_FIFTHS)])
    run = np.array([block.run for block in blocks])
    return Folds(_leave_gaps(test, run[1:] == run[:-1]), test, folds.by_run, parts, folds.recording)


def _cut(recording: np.ndarray, share: int) -> np.ndarray:
    """Part (B,) of each block, where every recording is cut into contiguous parts."""
    parts = np.empty(len(recording), dtype=int)
    for r in np.unique(recording):
        own = np.flatnonzero(recording == r)
        parts[own] = share * r + np.arange(len(own)) * share // len(own)
    return parts


def _leave_gaps(test: np.ndarray, adjacent: np.ndarray) -> np.ndarray:
    """Mask (F, B) of blocks to train on: neither held out nor next to a held-out block.

    `adjacent` (B - 1,) says of each block but the first whether it continues the one before.
    """
    near = test.copy()
    near[:, 1:] |= test[:, :-1] & adjacent
    near[:, :-1] |= test[:, 1:] & adjacent
    return ~near


def _spread_parts(motion: np.ndarray, count: int) -> np.ndarray:
    """Part (B,) of each block of a single run, so that every joint moves in enough parts, if possible."""
    blocks = len(motion)
    best = np.arange(blocks) * count // blocks
    if not motion.any():
        return best
    shares = motion[:, motion.any(axis=0)] / motion.sum(axis=0)[motion.any(axis=0)]

    def count_least(parts: np.ndarray) -> int:
        of_part = np.array([shares[parts == k].sum(axis=0) for k in range(count)])
        return int((of_part > _MOVES_IN / count).sum(axis=0).min())

    times = 1
    while count_least(best) < _ENOUGH and blocks // (count * (times + 1)) >= _SHORTEST_STRETCH:
        times += 1
        parts = np.arange(blocks) * count * times // blocks % count
        if count_least(parts) > count_least(best):
            best = parts
    return best
