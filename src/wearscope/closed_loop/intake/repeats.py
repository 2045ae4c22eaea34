"""Runs that are copies of each other, also trimmed, rounded or with another clock.

Every run has a signature: the values of all channels at its marks, the rows where the torques' sum is larger
than at any other row nearby. Such a row is a mark of the copy too, wherever the copy starts. Copies therefore
share many marks, and other runs share few. Only runs that share many are compared row by row.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, spatial

from wearscope.closed_loop.intake.recording import Run
from wearscope.closed_loop.intake.table_files import LEAST_ROWS

#: Runs whose aligned channels differ by less than this share of their spread are copies of each other.
_COPY = 1e-3
#: A copy shares at least the first part of the shorter run's rows, and the second part of its marks.
_OVERLAP, _SHARED = 0.2, 0.1
#: Half width of the window in which a mark is the maximum [s]; largest difference of a copy's mark, over the
#: channel's standard deviation.
_REACH, _APART = 0.2, 3e-3
_MOST_MARKS, _NEIGHBOURS = 2000, 8


@dataclass(frozen=True)
class Signature:
    """Signature by which a run is recognised.

    Attributes
    ----------
    rows : ndarray (A,)
        Marked rows.
    marks : ndarray (A, 2 n)
        Torques and positions there.
    spread : ndarray (2 n,)
        Standard deviation of each channel.
    """

    rows: np.ndarray
    marks: np.ndarray
    spread: np.ndarray


def sign_run(run: Run, rate: float) -> Signature:
    """Signature of a run as recorded."""
    channels = np.column_stack([run.tau, run.q])
    total = run.tau.sum(axis=1)
    width = 2 * max(3, int(_REACH * rate)) + 1
    marked = np.flatnonzero(ndimage.maximum_filter1d(total, width, mode="nearest") == total)
    return Signature(marked[:_MOST_MARKS], channels[marked[:_MOST_MARKS]], channels.std(axis=0))


def find_copies(
    signatures: list[Signature], pairs_matter: Callable[[int, int], bool], load: Callable[[int], Run]
) -> tuple[int, int] | None:
    """First pair (earlier, later) of runs of which one is a copy of the other; None where there is none.

    Parameters
    ----------
    signatures : list of Signature
    pairs_matter : callable
        Whether a copy between two runs would matter.
    load : callable
        Reads a run.
    """
    scale = np.maximum(np.median([s.spread for s in signatures], axis=0), 1e-12)
    marks = np.vstack([s.marks for s in signatures]) / scale
    row = np.concatenate([s.rows for s in signatures])
    of = np.repeat(np.arange(len(signatures)), [len(s.rows) for s in signatures])
    near = spatial.cKDTree(marks).query(marks, k=_NEIGHBOURS, p=np.inf, distance_upper_bound=_APART)[1]
    one = np.repeat(np.arange(len(marks)), _NEIGHBOURS)[near.ravel() < len(marks)]
    other = near.ravel()[near.ravel() < len(marks)]
    apart = of[one] < of[other]
    one, other = one[apart], other[apart]
    # All marks that a copy shares lie at the same shift.
    kinds = np.column_stack([of[one], of[other], row[one] - row[other]])
    found, shared = np.unique(kinds, axis=0, return_counts=True)
    for (i, k, shift), count in zip(found.tolist(), shared.tolist(), strict=True):
        least = _SHARED * min(len(signatures[i].rows), len(signatures[k].rows))
        if count >= least and pairs_matter(i, k) and is_copy(load(i), load(k), shift):
            return i, k
    return None


def is_copy(a: Run, b: Run, shift: int) -> bool:
    """Whether two runs hold the same recording: their channels agree more closely than noise allows.

    Parameters
    ----------
    a, b : Run
    shift : int
        Row of `a` at which `b` starts; negative where `b` starts earlier.
    """
    first, second = max(shift, 0), max(-shift, 0)
    shared = min(len(a.t) - first, len(b.t) - second)
    if shared < max(LEAST_ROWS, _OVERLAP * min(len(a.t), len(b.t))):
        return False
    for x, y in ((a.tau, b.tau), (a.q, b.q)):
        one, other = x[first : first + shared], y[second : second + shared]
        spread = np.maximum(one.std(axis=0), 1e-12)
        if np.any(np.quantile(np.abs(one - other), 0.9, axis=0) > _COPY * spread):
            return False
    return True
