"""How many independent rows the rows of autocorrelated data are worth, by sums over blocks of rows."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

#: Numbers of neighbouring blocks that are summed, and fewest sums from which a variance is estimated.
_JOINED, _FEWEST = (1, 2, 4, 8, 16, 32), 8


@dataclass(frozen=True, eq=False)
class JoinedBlocks:
    """Blocks of neighbouring rows, of which 1, 2, 4 ... 32 are joined within their runs.

    Attributes
    ----------
    starts : ndarray (B,) of int
        First row of each block.
    run : ndarray (B,) of int
        Run of each block.
    """

    starts: np.ndarray
    run: np.ndarray

    @cached_property
    def _joined(self) -> list[np.ndarray]:
        """First of the blocks of each sum, by the number of blocks that are joined."""
        apart, number = np.diff(self.run) != 0, np.arange(1, len(self.run))
        return [np.concatenate([[0], 1 + np.flatnonzero(apart | (number % count == 0))]) for count in _JOINED]

    def find_design_effect(self, product: np.ndarray) -> float:
        """Variance of a sum of rows over that of independent rows, the largest by joined blocks.

        Parameters
        ----------
        product : ndarray (M,)
            Zero in rows that do not count.
        """
        single = float(product @ product)
        if single <= 0.0:
            return 1.0
        by_block, worst = np.add.reduceat(product, self.starts), 1.0
        for starts in self._joined:
            sums = np.add.reduceat(by_block, starts)
            sums = sums[sums != 0.0]
            if len(sums) >= _FEWEST:
                worst = max(worst, float(sums @ sums) / single * len(sums) / (len(sums) - 1.0))
        return worst

    def count_rows(self, product: np.ndarray, count: float, most: float) -> float:
        """Independent rows that inform on a direction, of `count` rows, and no more than `most`.

        Parameters
        ----------
        product : ndarray (M,)
            The direction times what a model leaves, zero in rows that do not count.
        count, most : float
        """
        return 1.0 / (self.find_design_effect(product) / max(count, 1.0) + 1.0 / most)
