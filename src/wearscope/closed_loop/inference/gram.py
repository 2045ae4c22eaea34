"""Products of columns by unit, made once, and a model's fit from them.

A unit is the rows that the same folds are fitted on and hold out. All that a fit needs of the rows, on all
of them or with a fold held out, are sums over units of products of columns: `Gram` makes each product once,
and `Fit` puts a model's together.
"""

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise, takewhile
from weakref import WeakKeyDictionary

import numpy as np

from wearscope.closed_loop.inference.layout import Layout
from wearscope.closed_loop.inference.term import Term
from wearscope.closed_loop.model.regression import ROUNDS, SETTLED
from wearscope.closed_loop.model.terms import Candidate

#: Ridge on every coefficient, as a share of its information, for those that the runs do not determine.
TINY = 1e-10
#: Share of a column's square that a model leaves at least, even where it absorbs the column to rounding.
ROUNDING = 1e-9


class Gram:
    """Products by unit of the columns that models of a data set are made of.

    Parameters
    ----------
    layout : Layout
    target : ndarray (M, n)
        Torque to explain.
    """

    def __init__(self, layout: Layout, target: np.ndarray) -> None:
        self.layout, self.target = layout, target
        self.count = np.maximum(layout.keep.sum(axis=0), 1)
        self._pairs: WeakKeyDictionary[Candidate, WeakKeyDictionary] = WeakKeyDictionary()
        self._totals: WeakKeyDictionary[Candidate, WeakKeyDictionary] = WeakKeyDictionary()
        self._own: WeakKeyDictionary[Candidate, dict] = WeakKeyDictionary()
        self._scores: WeakKeyDictionary[Candidate, dict] = WeakKeyDictionary()
        self._sums: WeakKeyDictionary[Candidate, dict] = WeakKeyDictionary()

    @cached_property
    def power(self) -> np.ndarray:
        """Squares (U, n) of the target by unit."""
        out = np.zeros((self.layout.units.count, self.target.shape[1]))
        squares = self.target**2 * self.layout.keep
        for unit, part in self.layout.units.segments:
            out[unit] += squares[part].sum(axis=0)
        return out

    def _multiply(self, joint: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Products (U, a, b) of columns (M, a) and (M, b) in the rows of a joint that count."""
        out = np.zeros((self.layout.units.count, x.shape[1], y.shape[1]))
        y = y * self.layout.keep[:, joint, None]
        for unit, part in self.layout.units.segments:
            out[unit] += x[part].T @ y[part]
        return out

    def cross(self, a: Candidate, b: Candidate, joint: int) -> np.ndarray:
        """Products (U, k_a, k_b) of the columns of all shapes of two candidates at a joint."""
        kept = self._pairs.setdefault(a, WeakKeyDictionary()).setdefault(b, {})
        if joint not in kept:
            other = self._pairs.get(b)
            mirrored = None if other is None else other.get(a, {}).get(joint)
            x, y = (c.rows[c.joints.index(joint)] for c in (a, b))
            kept[joint] = self._multiply(joint, x, y) if mirrored is None else mirrored.swapaxes(1, 2)
        return np.asarray(kept[joint])

    def total(self, a: Candidate, b: Candidate, joint: int) -> np.ndarray:
        """The same (k_a, k_b) over all units."""
        kept = self._totals.setdefault(a, WeakKeyDictionary()).setdefault(b, {})
        if joint not in kept:
            kept[joint] = self.cross(a, b, joint).sum(axis=0)
        return np.asarray(kept[joint])

    def own(self, a: Candidate, joint: int) -> np.ndarray:
        """Products (U, S, m, m) of the columns of each shape of a candidate with each other."""
        kept = self._own.setdefault(a, {})
        if joint not in kept:
            rows = a.rows[a.joints.index(joint)]
            shapes, m = len(a.shapes), a.count
            out = np.zeros((self.layout.units.count, shapes, m, m))
            masked = rows * self.layout.keep[:, joint, None]
            for unit, part in self.layout.units.segments:
                x = masked[part].T.reshape(shapes, m, -1)
                out[unit] += x @ x.transpose(0, 2, 1)
            kept[joint] = out
        return np.asarray(kept[joint])

    def score(self, a: Candidate, joint: int) -> np.ndarray:
        """Products (U, k_a) of a candidate's columns with the target."""
        kept = self._scores.setdefault(a, {})
        if joint not in kept:
            rows = a.rows[a.joints.index(joint)]
            kept[joint] = self._multiply(joint, rows, self.target[:, joint, None])[..., 0]
        return np.asarray(kept[joint])

    def column_sums(self, a: Candidate, joint: int) -> np.ndarray:
        """Sums (k_a,) of a candidate's columns over the rows of a joint that count."""
        kept = self._sums.setdefault(a, {})
        if joint not in kept:
            kept[joint] = self.layout.keep[:, joint].astype(float) @ a.rows[a.joints.index(joint)]
        return np.asarray(kept[joint])


class Fit:
    """A model's fit: its parameters on all rows and on those of each fold, and what they leave.

    Parameters
    ----------
    gram : Gram
    terms : sequence of Term
    sigma : ndarray (n,)
        Residual scale by joint, whose inverse square weighs the rows.
    base : Fit, optional
        Fit of the same terms without the last one, from which this one is solved.
    like : Fit, optional
        Fit on the same columns, whose products are taken over; the base by default.
    """

    def __init__(
        self,
        gram: Gram,
        terms: Sequence[Term],
        sigma: np.ndarray,
        base: "Fit | None" = None,
        like: "Fit | None" = None,
    ) -> None:
        self.gram, self.terms, self.sigma, self.base = gram, tuple(terms), sigma, base
        self.weight = 1.0 / sigma**2
        n, units = gram.target.shape[1], gram.layout.units.count
        self.p = 0
        self.spans: list[slice] = []
        self.at = [np.zeros(0, dtype=int)] * n
        self._felt: list[list[int]] = [[] for _ in range(n)]
        self._grams = [np.zeros((units, 0, 0))] * n
        self._scores = [np.zeros((units, 0))] * n
        other = base if like is None else like
        known = 0 if other is None else self._take_over(other)
        for k, term in enumerate(self.terms[known:], start=known):
            span = self._place(term)
            for j in term.candidate.joints:
                self._grams[j], self._scores[j] = self._extend(j, term)
                self.at[j] = np.concatenate([self.at[j], np.arange(span.start, span.stop)])
                self._felt[j].append(k)

    def _place(self, term: Term) -> slice:
        """Place of a further term's parameters."""
        self.spans.append(slice(self.p, self.p + len(term.subset)))
        self.p = self.spans[-1].stop
        return self.spans[-1]

    def _take_over(self, other: "Fit") -> int:
        """Take over another fit's products of the first terms, and return the number of these."""
        places = dict(zip(other.terms, other.spans, strict=True))
        known = list(takewhile(places.__contains__, self.terms))
        index = np.full(other.p, -1)
        for term in known:
            span = self._place(term)
            index[places[term]] = np.arange(span.start, span.stop)
        for j, at in enumerate(other.at):
            own = index[at] >= 0
            every = bool(own.all())
            self._grams[j] = other._grams[j] if every else other._grams[j][:, own][..., own]
            self._scores[j] = other._scores[j] if every else other._scores[j][:, own]
            self.at[j] = index[at[own]]
            felt = [other.terms[k] for k in other._felt[j]]
            self._felt[j] = [known.index(term) for term in felt if term in known]
        return len(known)

    def _extend(self, joint: int, term: Term) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix (U, k, k) and right side (U, k) of a joint with a term more, not weighed."""
        gram, k, m = self.gram, len(self.at[joint]), len(term.subset)
        own = np.empty((len(self._grams[joint]), k + m, k + m))
        own[:, :k, :k] = self._grams[joint]
        start = 0
        for other in (self.terms[i] for i in self._felt[joint]):
            part = gram.cross(term.candidate, other.candidate, joint)[:, term.columns[:, None], other.columns]
            stop = start + len(other.subset)
            own[:, k:, start:stop], own[:, start:stop, k:] = part, part.swapaxes(1, 2)
            start = stop
        own[:, k:, k:] = gram.cross(term.candidate, term.candidate, joint)[
            :, term.columns[:, None], term.columns
        ]
        return own, np.concatenate(
            [self._scores[joint], gram.score(term.candidate, joint)[:, term.columns]], axis=1
        )

    @cached_property
    def normal(self) -> np.ndarray:
        """Normal matrix (U, P, P) by unit, weighed."""
        out = np.zeros((self.gram.layout.units.count, self.p, self.p))
        for k, own, weight in zip(self.at, self._grams, self.weight, strict=True):
            out[:, k[:, None], k] += own * weight
        return out

    @cached_property
    def score(self) -> np.ndarray:
        """Right side (U, P) by unit, weighed."""
        out = np.zeros((self.gram.layout.units.count, self.p))
        for k, score, weight in zip(self.at, self._scores, self.weight, strict=True):
            out[:, k] += score * weight
        return out

    @cached_property
    def prior(self) -> np.ndarray:
        """Prior precision (P, P)."""
        size = np.zeros(self.p)
        for k, own, weight in zip(self.at, self._grams, self.weight, strict=True):
            size[k] += np.einsum("uii->i", own) * weight
        out = np.diag(TINY * np.maximum(size, 1e-12))
        for term, span in zip(self.terms, self.spans, strict=True):
            if term.candidate.penalty is not None:
                out[span, span] += term.penalty / self._scale_of(term.candidate)
        return out

    def _scale_of(self, candidate: Candidate) -> float:
        """Residual variance that is the unit of a candidate's prior; 1 where the prior is absolute."""
        return float(self.sigma[candidate.joint] ** 2) if candidate.effect.empirical else 1.0

    @cached_property
    def solved(self) -> tuple[np.ndarray, np.ndarray]:
        """Inverse normal matrices (1 + F, P, P) and parameters (1 + F, P), on all rows and by fold.

        Those of a model with a base follow from the base's by the last term's Schur complement.
        """
        layout = self.gram.layout.units
        units = np.concatenate([np.ones((1, layout.count)), layout.train])
        if self.base is None:
            a = np.tensordot(units, self.normal, 1) + self.prior
            scale = 1.0 / np.sqrt(np.maximum(np.einsum("fii->fi", a), 1e-300))
            both = scale[:, :, None] * scale[:, None]
            inverse = np.linalg.inv(a * both) * both if self.p else a
            return inverse, np.einsum("fij,fj->fi", inverse, units @ self.score)
        term, span, m = self.terms[-1], self.spans[-1], len(self.terms[-1].subset)
        cross = np.zeros((len(units), self.p, m))
        own = np.repeat(self.prior[None, span, span], len(units), axis=0)
        score = np.zeros((len(units), m))
        for j in term.candidate.joints:
            before = self.at[j][:-m]
            part = np.tensordot(units, self._grams[j][:, :, -m:], 1) * self.weight[j]
            cross[:, before] += part[:, :-m]
            own += part[:, -m:]
            score += units @ self._scores[j][:, -m:] * self.weight[j]
        inverse, theta = self.base.solved
        cross = cross[:, : span.start]
        onto = inverse @ cross
        inner = own - cross.swapaxes(1, 2) @ onto
        inner = 0.5 * (inner + inner.swapaxes(1, 2))
        np.einsum("fmm->fm", inner)[...] += ROUNDING * np.einsum("fmm->fm", own) + 1e-300
        schur = np.linalg.inv(inner)
        away = score - np.einsum("fpm,fp->fm", cross, theta)
        beta = np.einsum("fij,fj->fi", schur, away)
        grown = np.empty((len(units), self.p, self.p))
        grown[:, : span.start, span] = -onto @ schur
        grown[:, : span.start, : span.start] = inverse - grown[:, : span.start, span] @ onto.swapaxes(1, 2)
        grown[:, span, : span.start] = grown[:, : span.start, span].swapaxes(1, 2)
        grown[:, span, span] = schur
        return grown, np.concatenate([theta - np.einsum("fpm,fm->fp", onto, beta), beta], axis=1)

    @property
    def theta(self) -> np.ndarray:
        """Parameters (P,) on all rows."""
        return np.asarray(self.solved[1][0])

    def _find(self, term: Term) -> slice:
        return next(span for t, span in zip(self.terms, self.spans, strict=True) if t is term)

    def coefficients(self, term: Term) -> np.ndarray:
        """Coefficients (m,) of a term of the model."""
        return self.theta[self._find(term)]

    def errors(self, term: Term, most_rows: float) -> np.ndarray:
        """Standard errors (m,) of its coefficients, with at most so many independent rows."""
        rows = max(float(self.gram.count[term.joint]) / most_rows, 1.0)
        return np.asarray(np.sqrt(rows * np.diag(self.solved[0][0])[self._find(term)]))

    def measure(self, term: Term) -> np.ndarray:
        """Gram matrix (m, m) of a term's columns on all rows, weighed."""
        joints = term.candidate.joints
        every = (self.gram.total(term.candidate, term.candidate, j) * self.weight[j] for j in joints)
        return np.asarray(sum(every)[np.ix_(term.columns, term.columns)])

    def find_level(self, term: Term) -> float:
        """Share of the square of a term's torque at its joint that is its mean's."""
        if term.joint not in term.candidate.joints:
            return 0.0
        beta = self.coefficients(term)
        total = self.gram.total(term.candidate, term.candidate, term.joint)
        square = float(beta @ total[np.ix_(term.columns, term.columns)] @ beta)
        mean = float(self.gram.column_sums(term.candidate, term.joint)[term.columns] @ beta)
        return mean**2 / max(square * float(self.gram.count[term.joint]), 1e-300)

    def _lose(self, joint: int, theta: np.ndarray) -> np.ndarray:
        """Sum of squares (U,) that parameters (U, P), or (P,), leave of each unit at a joint."""
        own = theta[..., self.at[joint]]
        onto = (self._grams[joint] @ own[..., None])[..., 0] - 2.0 * self._scores[joint]
        return np.asarray(self.gram.power[:, joint] + (onto * own).sum(axis=1))

    @cached_property
    def fitted(self) -> np.ndarray:
        """Sum of squares (n,) that the model leaves of all rows."""
        return np.array([max(self._lose(j, self.theta).sum(), 0.0) for j in range(len(self.at))])

    @cached_property
    def by_fold(self) -> np.ndarray:
        """Sum of squares (n, F) that the model leaves in the held-out rows of each fold."""
        test = self.gram.layout.units.test
        # Rows that no fold holds out are not counted.
        theta = self.solved[1][1 + test.argmax(axis=0)]
        return np.array([np.maximum(test @ self._lose(j, theta), 0.0) for j in range(len(self.at))])

    @cached_property
    def held_out(self) -> np.ndarray:
        """Sum of squares (n,) that the model leaves in held-out rows."""
        return np.asarray(self.by_fold.sum(axis=1))

    @cached_property
    def energy(self) -> float:
        """Squared size of named payloads and link errors, in standard deviations of what is expected."""
        spans = [s for t, s in zip(self.terms, self.spans, strict=True) if t.effect.spread]
        return float(sum(self.theta[s] @ self.prior[s, s] @ self.theta[s] for s in spans))

    def columns(self, joint: int) -> np.ndarray:
        """Columns (M, k) of the model at a joint."""
        parts = [self.terms[k].at_joint(joint) for k in self._felt[joint]]
        return np.concatenate([*parts, np.zeros((len(self.gram.target), 0))], axis=1)

    def predict(self, joint: int) -> np.ndarray:
        """Torque (M,) of the model at a joint."""
        if joint not in self._predicted:
            torque = np.zeros(len(self.gram.target))
            for k in self._felt[joint]:
                torque += self.terms[k].at_joint(joint) @ self.theta[self.spans[k]]
            self._predicted[joint] = torque
        return self._predicted[joint]

    @cached_property
    def _predicted(self) -> dict[int, np.ndarray]:
        return {}

    def leave(self, joint: int) -> np.ndarray:
        """Torque (M,) that the model leaves at a joint."""
        return np.asarray(self.gram.target[:, joint] - self.predict(joint))

    def leave_held_out(self, joint: int) -> np.ndarray:
        """Torque (M,) that the model leaves at a joint, each row's fold held out."""
        left, columns = self.gram.target[:, joint].copy(), self.columns(joint)
        for rows, theta in zip(self.gram.layout.units.test_rows, self.solved[1][1:], strict=True):
            left[rows] -= columns[rows] @ theta[self.at[joint]]
        return np.asarray(left)

    def settle_scale(self) -> np.ndarray:
        """Residual scale (n,) that agrees with the fit that is weighed by it.

        Effects felt at several joints are fitted to each joint by its weight, which depends on the residual
        there. Settling both in turn maximises the likelihood (Oberhofer and Kmenta 1974, Econometrica 42(3)).
        """
        if not any(len(term.candidate.joints) > 1 for term in self.terms):
            return np.asarray(np.sqrt(np.maximum(self.fitted / self.gram.count, 1e-18)))
        grams = [own.sum(axis=0) * w for own, w in zip(self._grams, self.weight, strict=True)]
        scores = [one.sum(axis=0) * w for one, w in zip(self._scores, self.weight, strict=True)]
        powers = self.gram.power.sum(axis=0) * self.weight
        relative = np.ones(len(grams))
        for _ in range(ROUNDS):
            a, b = self.prior.copy(), np.zeros(self.p)
            for k, own, score, width in zip(self.at, grams, scores, relative, strict=True):
                a[np.ix_(k, k)] += own / width**2
                b[k] += score / width**2
            scale = 1.0 / np.sqrt(np.maximum(np.diag(a), 1e-300))
            theta = scale * np.linalg.solve(a * np.outer(scale, scale), scale * b)
            left = [
                power - 2.0 * score @ theta[k] + theta[k] @ own @ theta[k]
                for k, own, score, power in zip(self.at, grams, scores, powers, strict=True)
            ]
            before = relative
            relative = np.sqrt(np.maximum(np.array(left) / self.gram.count, 1e-18))
            if np.all(np.abs(relative - before) <= SETTLED * before):
                break
        return np.asarray(np.maximum(relative * self.sigma, 1e-9))

    def know_elsewhere(self, joint: int) -> np.ndarray:
        """Information on the parameters felt at a joint, by the prior and by all other joints' rows."""
        k = self.at[joint]
        rest = np.setdiff1d(np.arange(self.p), k)
        a = self.normal.sum(axis=0) + self.prior
        a[np.ix_(k, k)] -= self._grams[joint].sum(axis=0) * self.weight[joint]
        if not len(rest):
            return np.asarray(a[np.ix_(k, k)])
        scale = 1.0 / np.sqrt(np.maximum(np.diag(a)[rest], 1e-300))
        inner = a[np.ix_(rest, rest)] * np.outer(scale, scale)
        onto = a[np.ix_(rest, k)] * scale[:, None]
        return np.asarray(a[np.ix_(k, k)] - onto.T @ np.linalg.solve(inner, onto))

    def project(self, terms: Sequence[Term]) -> tuple[np.ndarray, np.ndarray, list[slice]]:
        """Further terms' normal matrix (K, K), with the model projected out, right side (K,) and places."""
        edges = np.cumsum([0, *(len(t.subset) for t in terms)]).tolist()
        spans = [slice(a, b) for a, b in pairwise(edges)]
        inner = np.zeros((edges[-1], edges[-1]))
        for j, weight in enumerate(self.weight):
            felt = [(t, s) for t, s in zip(terms, spans, strict=True) if j in t.candidate.joints]
            if felt:
                at = np.concatenate([np.r_[s] for _, s in felt])
                x = np.concatenate([t.at_joint(j) for t, _ in felt], axis=1)
                inner[np.ix_(at, at)] += weight * (x.T @ (x * self.gram.layout.keep[:, j, None]))
        inner[np.diag_indices_from(inner)] += ROUNDING * np.diag(inner) + 1e-300
        cross, score = np.zeros((edges[-1], self.p)), np.zeros(edges[-1])
        for term, span in zip(terms, spans, strict=True):
            cross[span], score[span] = (x[term.columns] for x in self._multiply(term.candidate))
            if term.candidate.penalty is not None:
                inner[span, span] += term.penalty / self._scale_of(term.candidate)
        return inner - cross @ self.solved[0][0] @ cross.T, score - cross @ self.theta, spans

    def _multiply(self, candidate: Candidate) -> tuple[np.ndarray, np.ndarray]:
        """Products of a candidate's columns with the model's (k_a, P) and with the target (k_a,), weighed."""
        columns = len(candidate.shapes) * candidate.count
        cross, score = np.zeros((columns, self.p)), np.zeros(columns)
        for j in candidate.joints:
            score += self.weight[j] * self.gram.score(candidate, j).sum(axis=0)
            if self._felt[j]:
                terms = [self.terms[k] for k in self._felt[j]]
                both = [self.gram.total(candidate, t.candidate, j)[:, t.columns] for t in terms]
                cross[:, self.at[j]] += self.weight[j] * np.concatenate(both, axis=1)
        return cross, score

    def add(self, candidate: Candidate, subset: Sequence[int]) -> "Added":
        """What each shape of a candidate adds to the fit on all rows (Frisch, Waugh and Lovell).

        Parameters
        ----------
        candidate : Candidate
        subset : sequence of int
            Coefficients in use.
        """
        inner, reduced, own = self._project_candidate(candidate)
        pick = np.array(subset)
        inner, own = (x[:, pick[:, None], pick] for x in (inner, own))
        beta = np.linalg.solve(inner, reduced[:, pick, None])[..., 0]
        return Added(beta, (reduced[:, pick] * beta).sum(axis=1), inner, own)

    def _project_candidate(self, candidate: Candidate) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Projected normal matrices (S, m, m) and right sides (S, m) by shape, and the former as is."""
        if candidate not in self._projected:
            shapes, m = len(candidate.shapes), candidate.count
            cross, score = (x.reshape(shapes, m, *x.shape[1:]) for x in self._multiply(candidate))
            own = np.zeros((shapes, m, m))
            for j in candidate.joints:
                own += self.weight[j] * self.gram.own(candidate, j).sum(axis=0)
            power = np.einsum("smm->sm", own)
            if candidate.penalty is not None:
                own = own + candidate.penalty / self._scale_of(candidate)
            inverse, theta = self.solved[0][0], self.theta
            inner = own - cross @ inverse @ cross.swapaxes(1, 2)
            inner = 0.5 * (inner + inner.swapaxes(1, 2))
            np.einsum("smm->sm", inner)[...] += ROUNDING * power + 1e-300
            self._projected[candidate] = inner, score - cross @ theta, own
        return self._projected[candidate]

    @cached_property
    def _projected(self) -> WeakKeyDictionary[Candidate, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        return WeakKeyDictionary()


class Added:
    """What each shape of a candidate adds to a fit.

    Attributes
    ----------
    beta : ndarray (S, m)
        Its coefficients.
    gain : ndarray (S,)
        Reduction of the sum of squares, in residual variances.
    inner, own : ndarray (S, m, m)
        Its normal matrix with the model projected out, and without.
    """

    def __init__(self, beta: np.ndarray, gain: np.ndarray, inner: np.ndarray, own: np.ndarray) -> None:
        self.beta, self.gain, self.inner, self.own = beta, gain, inner, own
