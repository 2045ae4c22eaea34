"""Sums of a candidate's products by unit: rows that the same folds are fitted on and hold out."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Sums:
    """Sums of products of one candidate's columns (S shapes of m columns) by unit of the folds.

    Attributes
    ----------
    columns : ndarray (Q,)
        Parameters of the model that act at the candidate's joints.
    cross : ndarray (U, S, m, Q)
    gram : ndarray (U, S, m, m)
    score : ndarray (U, S, m)
    penalty : ndarray (m, m)
    rows : dict of int to ndarray (M, S, m)
        Its columns by joint, zero where a row does not count.
    """

    columns: np.ndarray
    cross: np.ndarray
    gram: np.ndarray
    score: np.ndarray
    penalty: np.ndarray
    rows: dict[int, np.ndarray]

    def select(self, subset: tuple[int, ...]) -> "Sums":
        """The same with a subset of the columns."""
        k = list(subset)
        if k == list(range(len(self.penalty))):
            return self
        return Sums(
            self.columns,
            self.cross[:, :, k],
            self.gram[:, :, k][..., k],
            self.score[:, :, k],
            self.penalty[np.ix_(k, k)],
            {j: x[..., k] for j, x in self.rows.items()},
        )

    def at(self, shape: int) -> "Sums":
        """The same with one of the shapes."""
        k = slice(shape, shape + 1)
        rows = {j: x[:, k] for j, x in self.rows.items()}
        return Sums(self.columns, self.cross[:, k], self.gram[:, k], self.score[:, k], self.penalty, rows)


@dataclass(frozen=True)
class Added:
    """What each shape of a candidate adds to the model on some units: (S, m), (S,), (S, m, m)."""

    beta: np.ndarray
    gain: np.ndarray
    inner: np.ndarray


def total(units: np.ndarray, by_unit: np.ndarray) -> np.ndarray:
    """Sums (..., *) over units (..., U) of what there is by unit (U, *)."""
    flat = units @ by_unit.reshape(len(by_unit), -1)
    return flat.reshape(*units.shape[:-1], *by_unit.shape[1:])
