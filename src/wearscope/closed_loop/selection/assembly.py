"""A model's normal equations by block and fold; what a candidate adds to it is answered from them alone.

Nothing here changes once it is made: evaluating a candidate twice, or in another order, gives the same bits.
"""

from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wearscope.closed_loop.model.candidates import Candidate
from wearscope.closed_loop.model.regression import ROUNDS, SETTLED
from wearscope.closed_loop.selection.layout import Layout, Products

#: Prior precision of every coefficient, of the information on it: for what the runs do not determine at all.
_TINY = 1e-10


@dataclass(frozen=True, eq=False)
class Chosen:
    """One shape of a candidate, with a subset of its coefficients, in a model.

    Attributes
    ----------
    candidate : Candidate
        With one shape.
    subset : tuple of int
    """

    candidate: Candidate
    subset: tuple[int, ...]

    @property
    def rows(self) -> list[np.ndarray]:
        """Columns (M, m) by joint of the candidate's."""
        return [x[:, list(self.subset)] for x in self.candidate.rows]


@dataclass(frozen=True)
class Sums:
    """Block sums of products of one candidate's columns (S shapes of m columns).

    Attributes
    ----------
    columns : ndarray (Q,)
        Parameters of the model that act at the candidate's joints.
    cross : ndarray (B, S, m, Q)
    gram : ndarray (B, S, m, m)
    score : ndarray (B, S, m)
    penalty : ndarray (m, m)
    """

    columns: np.ndarray
    cross: np.ndarray
    gram: np.ndarray
    score: np.ndarray
    penalty: np.ndarray

    def select(self, subset: tuple[int, ...]) -> "Sums":
        """The same with a subset of the columns."""
        k = list(subset)
        return Sums(
            self.columns,
            self.cross[:, :, k],
            self.gram[:, :, k][..., k],
            self.score[:, :, k],
            self.penalty[np.ix_(k, k)],
        )

    def at(self, shape: int) -> "Sums":
        """The same with one of the shapes."""
        k = slice(shape, shape + 1)
        return Sums(self.columns, self.cross[:, k], self.gram[:, k], self.score[:, k], self.penalty)


@dataclass(frozen=True)
class Added:
    """What each shape of a candidate adds to the model on some blocks: (S, m), (S,), (S, m, m)."""

    beta: np.ndarray
    gain: np.ndarray
    inner: np.ndarray


class Assembly:
    """Normal equations of a model.

    Parameters
    ----------
    layout : Layout
    target : ndarray (M, n)
        Torque to explain.
    chosen : tuple of Chosen
        The model's terms.
    sigma : ndarray (n,)
        Residual scale by joint, whose inverse square weighs the rows.
    joints : collection of int, optional
        Those that are asked about, and all that the terms felt there are felt at; all joints where None.
    """

    def __init__(
        self,
        layout: Layout,
        target: np.ndarray,
        chosen: tuple[Chosen, ...],
        sigma: np.ndarray,
        joints: Collection[int] | None = None,
    ) -> None:
        if joints is not None:
            chosen = tuple(c for c in chosen if set(c.candidate.joints) & set(joints))
        self.layout, self.target, self.chosen, self.sigma = layout, target, chosen, sigma
        n = target.shape[1]
        self.spans: list[slice] = []
        start = 0
        for term in chosen:
            self.spans.append(slice(start, start + len(term.subset)))
            start += len(term.subset)
        self.p = start
        at: list[list[np.ndarray]] = [[] for _ in range(n)]
        own: list[list[int]] = [[] for _ in range(n)]
        for term, span in zip(chosen, self.spans, strict=True):
            for j, x in zip(term.candidate.joints, term.rows, strict=True):
                at[j].append(x)
                own[j] += range(span.start, span.stop)
        self.at = [np.array(k, dtype=int) for k in own]
        self.columns = [np.concatenate(x, axis=1) if x else np.zeros((len(target), 0)) for x in at]
        blocks = len(layout.blocks)
        self.gram = np.zeros((blocks, self.p, self.p))
        self.score = np.zeros((blocks, self.p))
        self.power = np.zeros((blocks, n))
        self._packed: list[tuple[np.ndarray, np.ndarray]] = []
        none = np.zeros((blocks, 0, 0)), np.zeros((blocks, 0))
        for j in range(n):
            if joints is not None and j not in joints:
                self.at[j], self.columns[j] = self.at[j][:0], self.columns[j][:, :0]
                self._packed.append(none)
                continue
            x, y, gram, score = self._multiply(j)
            self._packed.append((x, y))
            k = self.at[j]
            self.gram[:, k[:, None], k] += gram
            self.score[:, k] += score
            self.power[:, j] = (y**2).sum(axis=1)
        self.prior = np.diag(_TINY * np.maximum(np.einsum("bii->i", self.gram), 1e-12))
        for term, span in zip(chosen, self.spans, strict=True):
            if term.candidate.penalty is not None:
                picked = list(term.subset)
                self.prior[span, span] += term.candidate.penalty[np.ix_(picked, picked)]

    def _multiply(self, joint: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Packed columns and target at a joint, and their products by block, in residual variances.

        The first term, which most models have in common, has the most columns: its products are made once.
        """
        layout, weight = self.layout, 1.0 / self.sigma[joint]
        keep = layout.keep[:, joint]
        y = layout.pack(self.target[:, joint] * keep)
        columns, count = self.columns[joint], 0
        first = next((c for c in self.chosen if joint in c.candidate.joints), None)
        parts, grams, scores = [], [], []
        if first is not None:
            count = len(first.subset)
            owner = (first.candidate, first.subset, self.target)
            made = layout.first_terms.get(joint)
            if made is None or not made.is_of(owner):
                x = layout.pack(columns[:, :count] * keep[:, None])
                turned = x.transpose(0, 2, 1)
                score = np.matmul(turned, y[..., None])[..., 0]
                made = layout.first_terms[joint] = Products(owner, x, np.matmul(turned, x), score)
            parts, grams, scores = [made.x], [made.gram], [made.score]
        if columns.shape[1] > count:
            x = layout.pack(columns[:, count:] * keep[:, None])
            turned = x.transpose(0, 2, 1)
            cross = [np.matmul(turned, part) for part in parts]
            own = np.concatenate([*cross, np.matmul(turned, x)], axis=2)
            above = [
                np.concatenate([g, c.transpose(0, 2, 1)], axis=2) for g, c in zip(grams, cross, strict=True)
            ]
            grams = [np.concatenate([*above, own], axis=1)]
            scores = [np.concatenate([*scores, np.matmul(turned, y[..., None])[..., 0]], axis=1)]
            parts = [np.concatenate([*parts, x], axis=2)]
        if not parts:
            blocks = len(y)
            return (
                np.zeros((blocks, y.shape[1], 0)),
                y * weight,
                np.zeros((blocks, 0, 0)),
                np.zeros((blocks, 0)),
            )
        return parts[0] * weight, y * weight, grams[0] * weight**2, scores[0] * weight**2

    @cached_property
    def by_fifths(self) -> "Assembly":
        """The same model with fifths of every recording held out."""
        if self.layout.by_fifths is self.layout:
            return self
        other = copy(self)
        for folded in ("by_fold", "joint_losses"):
            other.__dict__.pop(folded, None)
        other.layout = self.layout.by_fifths
        return other

    def _solve(self, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inverse (P, P) of the normal matrix on blocks, and the parameters (P,)."""
        a = self.gram[mask].sum(axis=0) + self.prior
        scale = 1.0 / np.sqrt(np.maximum(np.diag(a), 1e-300))
        inverse = np.linalg.inv(a * np.outer(scale, scale)) * np.outer(scale, scale) if self.p else a
        return inverse, inverse @ self.score[mask].sum(axis=0)

    @cached_property
    def whole(self) -> tuple[np.ndarray, np.ndarray]:
        """Inverse normal matrix and parameters on all blocks."""
        return self._solve(np.ones(len(self.gram), dtype=bool))

    @cached_property
    def by_fold(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The same on each fold's training blocks."""
        return [self._solve(mask) for mask in self.layout.folds.train]

    def settle_scale(self) -> np.ndarray:
        """Residual scale (n,) by which the model is weighed and which it then leaves.

        What is felt at several joints is fitted to each of them by its weight, which is what that leaves
        there: the likelihood's maximum over both, by turns (Oberhofer and Kmenta 1974, Econometrica 42(3)).
        Where joints leave a thousandth of each other's torque, that takes several rounds.
        """
        count = np.maximum(self.layout.keep.sum(axis=0), 1)
        if not any(len(chosen.candidate.joints) > 1 for chosen in self.chosen):
            mean = np.sum(self.residual**2 * self.layout.keep, axis=0) / count
            return np.asarray(np.sqrt(np.maximum(mean, 1e-18)))
        sums = [
            (np.einsum("blp,blq->pq", x, x), np.einsum("blp,bl->p", x, y), float((y**2).sum()))
            for x, y in self._packed
        ]
        relative = np.ones(len(sums))
        for _ in range(ROUNDS):
            a, b = self.prior.copy(), np.zeros(self.p)
            for k, (gram, score, _), width in zip(self.at, sums, relative, strict=True):
                a[np.ix_(k, k)] += gram / width**2
                b[k] += score / width**2
            scale = 1.0 / np.sqrt(np.maximum(np.diag(a), 1e-300))
            theta = scale * np.linalg.solve(a * np.outer(scale, scale), scale * b)
            left = [
                power - 2.0 * score @ theta[k] + theta[k] @ gram @ theta[k]
                for k, (gram, score, power) in zip(self.at, sums, strict=True)
            ]
            before, relative = relative, np.sqrt(np.maximum(np.array(left) / count, 1e-18))
            if np.all(np.abs(relative - before) <= SETTLED * before):
                break
        return np.maximum(relative * self.sigma, 1e-9)

    def know_elsewhere(self, joint: int) -> np.ndarray:
        """Information on the parameters felt at a joint, by the prior and by all other joints' rows."""
        k = self.at[joint]
        rest = np.setdiff1d(np.arange(self.p), k)
        x = self._packed[joint][0]
        a = self.gram.sum(axis=0) + self.prior
        a[np.ix_(k, k)] -= np.einsum("blp,blq->pq", x, x)
        if not len(rest):
            return np.asarray(a[np.ix_(k, k)])
        scale = 1.0 / np.sqrt(np.maximum(np.diag(a)[rest], 1e-300))
        inner = a[np.ix_(rest, rest)] * np.outer(scale, scale)
        onto = a[np.ix_(rest, k)] * scale[:, None]
        return np.asarray(a[np.ix_(k, k)] - onto.T @ np.linalg.solve(inner, onto))

    @property
    def theta(self) -> np.ndarray:
        """Parameters (P,)."""
        return self.whole[1]

    @cached_property
    def predicted(self) -> np.ndarray:
        """Torque (M, n) of all terms."""
        return np.column_stack([x @ self.theta[k] for x, k in zip(self.columns, self.at, strict=True)])

    @property
    def residual(self) -> np.ndarray:
        """Torque (M, n) that the model leaves of the target."""
        return self.target - self.predicted

    @cached_property
    def left(self) -> np.ndarray:
        """Scores (B, P) of the model's own columns with the residual."""
        return self.score - self.gram @ self.theta

    @cached_property
    def joint_losses(self) -> np.ndarray:
        """Held-out loss by block and joint (B, n), in residual variances."""
        out = np.empty_like(self.power)
        for (_, theta), test in zip(self.by_fold, self.layout.folds.test, strict=True):
            for j, (x, y) in enumerate(self._packed):
                out[test, j] = ((y[test] - x[test] @ theta[self.at[j]]) ** 2).sum(axis=1)
        return out

    @cached_property
    def fitted_losses(self) -> np.ndarray:
        """Loss by block and joint (B, n) of the model fitted on all blocks, in residual variances."""
        each = zip(self._packed, self.at, strict=True)
        return np.stack([((y - x @ self.theta[k]) ** 2).sum(axis=1) for (x, y), k in each], axis=1)

    @cached_property
    def sample_losses(self) -> np.ndarray:
        """Loss on all blocks by joint, (n,)."""
        return np.asarray(self.fitted_losses.sum(axis=0))

    def sum_products(self, candidate: Candidate) -> Sums:
        """Block sums of a candidate's columns with its own, the model's and the target's."""
        shapes, m = len(candidate.shapes), candidate.count
        blocks = len(self.gram)
        columns = np.unique(np.concatenate([self.at[j] for j in candidate.joints]))
        cross = np.zeros((blocks, shapes, m, len(columns)))
        gram = np.zeros((blocks, shapes, m, m))
        score = np.zeros((blocks, shapes, m))
        for j, rows in zip(candidate.joints, candidate.rows, strict=True):
            x = self.layout.pack(rows * (self.layout.keep[:, j] / self.sigma[j])[:, None])
            turned = x.transpose(0, 2, 1)
            model, y = self._packed[j]
            at = np.searchsorted(columns, self.at[j])
            cross[..., at] += np.matmul(turned, model).reshape(blocks, shapes, m, -1)
            score += np.matmul(turned, y[..., None]).reshape(blocks, shapes, m)
            split = x.reshape(*x.shape[:2], shapes, m).transpose(0, 2, 1, 3)
            gram += np.matmul(split.transpose(0, 1, 3, 2), split)
        penalty = np.zeros((m, m)) if candidate.penalty is None else candidate.penalty
        return Sums(columns, cross, gram, score, penalty)

    def add(self, sums: Sums, fold: int | None = None) -> Added:
        """Fit each shape beside the model on a fold's training blocks, or all (Frisch-Waugh-Lovell)."""
        if fold is None:
            (inverse, theta), mask = self.whole, slice(None)
        else:
            (inverse, theta), mask = self.by_fold[fold], self.layout.folds.train[fold]
        k = sums.columns
        cross = sums.cross[mask].sum(axis=0)
        own = sums.gram[mask].sum(axis=0) + sums.penalty
        onto = cross @ inverse[np.ix_(k, k)]
        inner = own - onto @ cross.transpose(0, 2, 1)
        inner = 0.5 * (inner + inner.transpose(0, 2, 1))
        # What the model absorbs to rounding must not come back with a huge coefficient.
        diagonal = np.einsum("smm->sm", own)
        np.einsum("smm->sm", inner)[...] += 1e-9 * diagonal + 1e-300
        reduced = sums.score[mask].sum(axis=0) - cross @ theta[k]
        beta = np.linalg.solve(inner, reduced[..., None])[..., 0]
        return Added(beta, np.einsum("sm,sm->s", reduced, beta), inner)

    def hold_out(self, sums: Sums) -> np.ndarray:
        """Held-out loss by block (B,) less that of the model, with the shape chosen anew in each fold."""
        change = np.full(len(self.gram), np.nan)
        for f, test in enumerate(self.layout.folds.test):
            added = self.add(sums, f)
            s = int(np.argmax(added.gain))
            mask = self.layout.folds.train[f]
            change[test] = self._change(sums.at(s), added.beta[s], self.by_fold[f], mask, test)
        return change

    def fit_change(self, sums: Sums, beta: np.ndarray) -> float:
        """Loss on all blocks less that of the model, with one shape's columns fitted beside it; (m,) in."""
        every = np.ones(len(self.gram), dtype=bool)
        return float(self._change(sums, beta, self.whole, every, every).sum())

    def _change(
        self, sums: Sums, beta: np.ndarray, fit: tuple[np.ndarray, np.ndarray], mask: np.ndarray,
        test: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """Change of the loss on blocks `test` by columns added to a model fitted on blocks `mask`."""
        inverse, theta = fit
        k = sums.columns
        shift = -inverse[:, k] @ (sums.cross[mask, 0].sum(axis=0).T @ beta)
        gram = self.gram[test]
        own = self.score[test] - gram @ theta
        cross = sums.cross[test, 0]
        return np.asarray(
            -2.0 * own @ shift
            + (gram @ shift) @ shift
            - 2.0 * (sums.score[test, 0] - cross @ theta[k]) @ beta
            + 2.0 * (cross @ shift[k]) @ beta
            + (sums.gram[test, 0] @ beta) @ beta
        )

    def block_scores(self, sums: Sums) -> np.ndarray:
        """Scores (B, S, m): the columns, with the model projected out, times the model's residual."""
        k = sums.columns
        inverse, theta = self.whole
        onto = np.einsum("smq,pq->smp", sums.cross.sum(axis=0), inverse[:, k])
        return sums.score - sums.cross @ theta[k] - np.einsum("bp,smp->bsm", self.left, onto)


def find_reach(terms: Sequence[Chosen], candidate: Candidate) -> set[int]:
    """Joints that a model couples to those where a candidate is felt, these included."""
    reach = set(candidate.joints)
    grown = True
    while grown:
        more = {j for t in terms if reach & set(t.candidate.joints) for j in t.candidate.joints}
        grown = not more <= reach
        reach |= more
    return reach
