"""How much columns explain of many torques at once, held out and fitted, from sums by unit."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from wearscope.closed_loop.inference.gram import ROUNDING, TINY
from wearscope.closed_loop.inference.layout import Layout


def total(units: np.ndarray, by_unit: np.ndarray) -> np.ndarray:
    """Sums (..., *) of values by unit (U, *), over chosen units (..., U)."""
    flat = units @ by_unit.reshape(len(by_unit), -1)
    return flat.reshape(*units.shape[:-1], *by_unit.shape[1:])


@dataclass(frozen=True)
class Target:
    """Torques to explain (S of them), and the model's fit to each.

    Attributes
    ----------
    values : ndarray (K, S)
        In rows that count, by unit.
    theta : ndarray (F, p, S)
        The model's parameters, by fold, and last of all rows.
    left : ndarray (F, p, S)
        Its columns times what it leaves of the rows that are held out.
    loss : ndarray (2, S)
        Loss of the model, held out and fitted.
    """

    values: np.ndarray
    theta: np.ndarray
    left: np.ndarray
    loss: np.ndarray


class HeldOut:
    """Sums of a model's columns at one joint, by unit: blocks that are fitted and held out in the same folds.

    Parameters
    ----------
    layout : Layout
    every : int
        One row in so many counts.
    keep : ndarray (M,) of bool
        Those of them that count.
    model : ndarray (M, p)
    known : ndarray (p, p)
        Information on the model's parameters in addition to these rows', about zero.
    """

    def __init__(
        self, layout: Layout, every: int, keep: np.ndarray, model: np.ndarray, known: np.ndarray
    ) -> None:
        units = layout.units
        of_row, kept = units.of_row[::every], np.flatnonzero(keep)
        self.order = kept[np.argsort(of_row[kept], kind="stable")]
        edges = np.searchsorted(of_row[self.order], np.arange(units.count + 1))
        self.units = [slice(a, b) for a, b in pairwise(edges.tolist())]
        whole = np.ones((1, units.count))
        self.train, self.test = np.concatenate([units.train, whole]), np.concatenate([units.test, whole])
        self.model = model[self.order]
        # Keyed by the identity of the columns' array, which is kept so that no other array gets the same
        # identity.
        self._known: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self.gram = self._sum(self.model, self.model)
        self.held = total(self.test, self.gram)
        self.inverse = np.array([self._invert(a + known) for a in total(self.train, self.gram)])

    def _sum(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.array([x[u].T @ y[u] for u in self.units])

    @staticmethod
    def _invert(a: np.ndarray) -> np.ndarray:
        scale = 1.0 / np.sqrt(np.maximum(np.diag(a), 1e-300))
        both = np.outer(scale, scale)
        return np.asarray(np.linalg.inv(a * both + TINY * np.eye(len(a))) * both)

    def target(self, torque: np.ndarray) -> Target:
        """Torques (M, S) at the rows that count, ready to be explained."""
        values = torque[self.order]
        power = np.array([(values[u] ** 2).sum(axis=0) for u in self.units])
        score = self._sum(self.model, values)
        theta = self.inverse @ total(self.train, score)
        held = total(self.test, score)
        left = held - self.held @ theta
        loss = self.test @ power - ((held + left) * theta).sum(axis=1)
        return Target(values, theta, left, _join(loss))

    def explain(self, columns: np.ndarray, penalty: np.ndarray, target: Target) -> np.ndarray:
        """Shares (2, S) of the model's loss, held out and fitted, that further columns remove.

        Parameters
        ----------
        columns : ndarray (M, m)
        penalty : ndarray (m, m)
            Ridge of their coefficients.
        target : Target
        """
        z = columns[self.order]
        if id(columns) not in self._known:
            self._known[id(columns)] = columns, self._sum(z, z), self._sum(z, self.model)
        _, gram, cross = self._known[id(columns)]
        score = self._sum(z, target.values)
        own, onto = total(self.train, gram), total(self.train, cross)
        shift = self.inverse @ onto.transpose(0, 2, 1)
        size = np.einsum("fmm->fm", own)
        inner = own - onto @ shift + penalty + (ROUNDING * size + 1e-300)[:, None] * np.eye(z.shape[1])
        beta = np.linalg.solve(inner, total(self.train, score) - onto @ target.theta)
        held = total(self.test, cross)
        mixed, back = held @ shift, shift.transpose(0, 2, 1)
        square = total(self.test, gram) - mixed - mixed.transpose(0, 2, 1) + back @ self.held @ shift
        linear = total(self.test, score) - held @ target.theta - back @ target.left
        gain = ((2.0 * linear - square @ beta) * beta).sum(axis=1)
        return np.asarray(_join(gain) / np.maximum(target.loss, 1e-300))


def _join(by_fold: np.ndarray) -> np.ndarray:
    """Sums (2, S) over the folds, and that of all rows, which comes last (F, S)."""
    return np.array([by_fold[:-1].sum(axis=0), by_fold[-1]])
