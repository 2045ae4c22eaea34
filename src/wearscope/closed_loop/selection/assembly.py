"""A model's normal equations by fold; what a candidate adds to it takes them and one pass over the rows.

Nothing here changes once it is made: evaluating a candidate twice, or in another order, gives the same bits.
"""

from collections.abc import Collection
from functools import cached_property

import numpy as np

from wearscope.closed_loop.model.candidates import Candidate
from wearscope.closed_loop.model.regression import ROUNDS, SETTLED
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.layout import Layout
from wearscope.closed_loop.selection.sums import Added, Sums, total

#: Prior precision of every coefficient, of the information on it: for what the runs do not determine at all.
_TINY = 1e-10


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
        self.asked = range(n) if joints is None else sorted(joints)
        self.spans: list[slice] = []
        own: list[list[int]] = [[] for _ in range(n)]
        self.p = 0
        for term in chosen:
            span = slice(self.p, self.p + len(term.subset))
            self.spans.append(span)
            self.p = span.stop
            for j in set(term.candidate.joints) & set(self.asked):
                own[j] += range(span.start, span.stop)
        self.at = [np.array(k, dtype=int) for k in own]
        self.weight = 1.0 / sigma**2
        self._own = [
            layout.multiply(
                j, target, [c for c in chosen if j in c.candidate.joints] if j in self.asked else []
            )
            for j in range(n)
        ]
        units = layout.units.count
        self.gram = np.zeros((units, self.p, self.p))
        self.score = np.zeros((units, self.p))
        for k, products, weight in zip(self.at, self._own, self.weight, strict=True):
            self.gram[:, k[:, None], k] += products.gram * weight
            self.score[:, k] += products.score * weight
        self.prior = np.diag(_TINY * np.maximum(np.einsum("uii->i", self.gram), 1e-12))
        for term, span in zip(chosen, self.spans, strict=True):
            if term.candidate.penalty is not None:
                picked = list(term.subset)
                self.prior[span, span] += term.candidate.penalty[np.ix_(picked, picked)]

    @property
    def columns(self) -> list[np.ndarray]:
        """Columns (M, k) by joint."""
        return [own.columns for own in self._own]

    @cached_property
    def by_fifths(self) -> "Assembly":
        """The same model with fifths of every recording held out."""
        if self.layout.by_fifths is self.layout:
            return self
        return Assembly(self.layout.by_fifths, self.target, self.chosen, self.sigma, self.asked)

    def _solve(self, units: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inverse (P, P) of the normal matrix on units (U,), and the parameters (P,)."""
        a = total(units, self.gram) + self.prior
        scale = 1.0 / np.sqrt(np.maximum(np.diag(a), 1e-300))
        inverse = np.linalg.inv(a * np.outer(scale, scale)) * np.outer(scale, scale) if self.p else a
        return inverse, inverse @ (units @ self.score)

    @cached_property
    def whole(self) -> tuple[np.ndarray, np.ndarray]:
        """Inverse normal matrix and parameters on all rows."""
        return self._solve(np.ones(len(self.gram)))

    @cached_property
    def by_fold(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The same on each fold's training rows."""
        return [self._solve(units) for units in self.layout.units.train]

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
            (own.gram.sum(axis=0) * w, own.score.sum(axis=0) * w, float(own.target @ own.target) * w)
            for own, w in zip(self._own, self.weight, strict=True)
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
        a = self.gram.sum(axis=0) + self.prior
        a[np.ix_(k, k)] -= self._own[joint].gram.sum(axis=0) * self.weight[joint]
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
    def held_out(self) -> np.ndarray:
        """The same (M, n) with each row's block held out; NaN in blocks that no fold holds out."""
        left = np.full_like(self.target, np.nan)
        for (_, theta), rows in zip(self.by_fold, self.layout.units.test_rows, strict=True):
            left[rows] = 0.0
            for j in self.asked:
                left[rows, j] = self.target[rows, j] - self.columns[j][rows] @ theta[self.at[j]]
        return left

    @cached_property
    def left(self) -> np.ndarray:
        """Scores (B, P) of the model's own columns with the residual."""
        out = np.zeros((len(self.layout.blocks), self.p))
        for j in self.asked:
            own = self.weight[j] * self.layout.keep[:, j] * self.residual[:, j]
            out[:, self.at[j]] += self.layout.sum_blocks(self.columns[j] * own[:, None])
        return out

    @cached_property
    def joint_losses(self) -> np.ndarray:
        """Held-out loss by block and joint (B, n), in residual variances."""
        return self.layout.sum_blocks(self.held_out**2 * self.layout.keep) * self.weight

    @cached_property
    def fitted_losses(self) -> np.ndarray:
        """Loss by block and joint (B, n) of the model fitted on all blocks, in residual variances."""
        return self.layout.sum_blocks(self.residual**2 * self.layout.keep) * self.weight

    @cached_property
    def sample_losses(self) -> np.ndarray:
        """Loss on all blocks by joint, (n,)."""
        return np.asarray(self.fitted_losses.sum(axis=0))

    def sum_products(self, candidate: Candidate) -> Sums:
        """Sums of a candidate's columns with its own, the model's and the target's."""
        shapes, m = len(candidate.shapes), candidate.count
        units = len(self.gram)
        columns = np.unique(np.concatenate([self.at[j] for j in candidate.joints]))
        cross = np.zeros((units, shapes, m, len(columns)))
        gram = np.zeros((units, shapes, m, m))
        score = np.zeros((units, shapes, m))
        rows: dict[int, np.ndarray] = {}
        for j, x in zip(candidate.joints, candidate.rows, strict=True):
            own, weight = self._own[j], self.weight[j]
            x = x * self.layout.keep[:, j, None]
            rows[j] = x.reshape(len(x), shapes, m)
            at = np.searchsorted(columns, self.at[j])
            for unit, part in self.layout.units.segments:
                turned = x[part].T
                cross[unit][..., at] += weight * (turned @ own.columns[part]).reshape(shapes, m, -1)
                score[unit] += weight * (turned @ own.target[part]).reshape(shapes, m)
                split = turned.reshape(shapes, m, -1)
                gram[unit] += weight * (split @ split.transpose(0, 2, 1))
        penalty = np.zeros((m, m)) if candidate.penalty is None else candidate.penalty
        return Sums(columns, cross, gram, score, penalty, rows)

    def add(self, sums: Sums) -> Added:
        """Fit each shape with the model on all rows (Frisch-Waugh-Lovell)."""
        inverse, theta = self.whole
        every = self._fit(sums, np.ones((1, len(self.gram))), inverse[None], theta[None])
        return Added(every.beta[0], every.gain[0], every.inner[0])

    def add_by_fold(self, sums: Sums) -> Added:
        """The same on each fold's training rows: (F, S, m), (F, S), (F, S, m, m)."""
        inverse, theta = (np.array(each) for each in zip(*self.by_fold, strict=True))
        return self._fit(sums, self.layout.units.train, inverse, theta)

    def _fit(self, sums: Sums, units: np.ndarray, inverse: np.ndarray, theta: np.ndarray) -> Added:
        """Fit each shape on sets of units (F, U), given what the model's parameters are on each of them."""
        k = sums.columns
        cross, score = total(units, sums.cross), total(units, sums.score)
        own = total(units, sums.gram) + sums.penalty
        onto = cross @ inverse[:, None, k[:, None], k]
        inner = own - onto @ cross.swapaxes(-1, -2)
        inner = 0.5 * (inner + inner.swapaxes(-1, -2))
        # What the model absorbs to rounding must not come back with a huge coefficient.
        np.einsum("fsmm->fsm", inner)[...] += 1e-9 * np.einsum("fsmm->fsm", own) + 1e-300
        reduced = score - (cross @ theta[:, None, k, None])[..., 0]
        beta = np.linalg.solve(inner, reduced[..., None])[..., 0]
        return Added(beta, (reduced * beta).sum(axis=-1), inner)

    def hold_out(self, sums: Sums) -> np.ndarray:
        """Held-out loss by block and joint (B, n) less the model's, the shape chosen in each fold."""
        moved = np.full_like(self.target, np.nan)
        added = self.add_by_fold(sums)
        for f, (rows, s) in enumerate(
            zip(self.layout.units.test_rows, added.gain.argmax(axis=1), strict=True)
        ):
            units, inverse = self.layout.units.train[f], self.by_fold[f][0]
            moved[rows] = self._torque(sums, int(s), added.beta[f, s], inverse, units, rows)
        return self._change(self.held_out, moved)

    def fit_change(self, sums: Sums, beta: np.ndarray) -> np.ndarray:
        """Loss by joint (n,) less that of the model, with one shape's columns fitted with it; (m,) in."""
        moved = self._torque(sums, 0, beta, self.whole[0], np.ones(len(self.gram)), slice(None))
        return np.asarray(self._change(self.residual, moved).sum(axis=0))

    def _torque(
        self, sums: Sums, shape: int, beta: np.ndarray, inverse: np.ndarray, units: np.ndarray,
        rows: np.ndarray | slice,
    ) -> np.ndarray:  # fmt: skip
        """Change of the torque (K, n) at some rows by one shape's columns, the model fitted with them."""
        k = sums.columns
        shift = -inverse[:, k] @ (total(units, sums.cross[:, shape]).T @ beta)
        out = np.zeros_like(self.target[rows])
        for j in self.asked:
            moved = shift[self.at[j]]
            if moved.any():
                out[:, j] = self.columns[j][rows] @ moved
        for j, x in sums.rows.items():
            out[:, j] += x[rows, shape] @ beta
        return out

    def _change(self, left: np.ndarray, added: np.ndarray) -> np.ndarray:
        """Change of the loss (B, n) where a torque is added to what a model leaves."""
        return self.layout.sum_blocks((added - 2.0 * left) * added * self.layout.keep) * self.weight

    def block_scores(self, sums: Sums) -> np.ndarray:
        """Scores (B, S, m): the columns, with the model projected out, times the model's residual."""
        onto = np.einsum("smq,pq->smp", sums.cross.sum(axis=0), self.whole[0][:, sums.columns])
        scores = -np.einsum("bp,smp->bsm", self.left, onto)
        for j, x in sums.rows.items():
            scores += self.layout.sum_blocks(x * (self.weight[j] * self.residual[:, j])[:, None, None])
        return scores

    def inform(self, sums: Sums, beta: np.ndarray) -> np.ndarray:
        """Power (B,) of one shape's torque, in residual variances."""
        each = (self.weight[j] * (x[:, 0] @ beta) ** 2 for j, x in sums.rows.items())
        return self.layout.sum_blocks(sum(each))

    def relieve_prior(self, sums: Sums, beta: np.ndarray) -> float:
        """By how much the parameters come nearer to where they are expected, given one shape's columns.

        Difference of the squared distances, in standard deviations a priori.
        """
        inverse, theta = self.whole
        given = theta - inverse[:, sums.columns] @ (sums.cross[:, 0].sum(axis=0).T @ beta)
        return float(theta @ self.prior @ theta - given @ self.prior @ given)

    @cached_property
    def joint_sums(self) -> np.ndarray:
        """Held-out losses (2, n) by joint [squares of the torque], with runs and with fifths held out."""
        sums = [np.nansum(one.joint_losses, axis=0) for one in (self, self.by_fifths)]
        return np.array(sums) * self.sigma**2
