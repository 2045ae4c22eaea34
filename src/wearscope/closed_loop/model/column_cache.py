"""A candidate's columns: kept as long as there is memory, otherwise computed again at each use."""

import weakref
from collections.abc import Callable, Sequence
from typing import overload

import numpy as np


class ColumnCache:
    """Memory for columns: it keeps the first ones that fit, and of all others only the last ones computed.

    Parameters
    ----------
    size : int
        Size of the memory [bytes].
    """

    def __init__(self, size: int) -> None:
        self.left = size
        self._last: tuple[weakref.ref[CachedColumns], np.ndarray] | None = None

    def keep(self, owner: "CachedColumns", rows: np.ndarray) -> bool:
        """Keep rows as long as their owner exists, if there is memory; return whether there is."""
        if rows.nbytes <= self.left:
            self.left -= rows.nbytes
            weakref.finalize(owner, self._give_back, rows.nbytes)
            return True
        self._last = (weakref.ref(owner), rows)
        return False

    def find_last(self, owner: "CachedColumns") -> np.ndarray | None:
        """Rows of an owner, if they are the last ones that were not kept."""
        return self._last[1] if self._last is not None and self._last[0]() is owner else None

    def _give_back(self, size: int) -> None:
        self.left += size


class CachedColumns(Sequence[np.ndarray]):
    """Columns (M, m) of a candidate that acts at one joint, as a sequence of one array (`Candidate.rows`).

    Parameters
    ----------
    cache : ColumnCache
    make : callable
        Computes the columns; the result must be the same to the last bit at every call.
    """

    def __init__(self, cache: ColumnCache, make: Callable[[], np.ndarray]) -> None:
        self._cache, self._make = cache, make
        self._kept: np.ndarray | None = None

    def __len__(self) -> int:
        return 1

    @overload
    def __getitem__(self, index: int) -> np.ndarray: ...

    @overload
    def __getitem__(self, index: slice) -> list[np.ndarray]: ...

    def __getitem__(self, index: int | slice) -> np.ndarray | list[np.ndarray]:
        return [self._take()][index]

    def _take(self) -> np.ndarray:
        if self._kept is not None:
            return self._kept
        rows = self._cache.find_last(self)
        if rows is None:
            rows = self._make()
            if self._cache.keep(self, rows):
                self._kept = rows
        return rows
