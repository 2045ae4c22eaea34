"""Evidence in the rows of a session: fits of sets of changes, and the score that compares two sets.

The residual of a session against the reference's prediction is y = Z d + C b + e, with changes d, random
effects b and autocorrelated noise e. Random effects are the error of the reference's parameters, temperatures
that were not recorded, and the scatter of healthy sessions. They are part of every fit, and their size is a
cost of it. Sets a and b are compared in nats by

    ln BF = sum_j nu_j / 2 ln((L_j(a) + f_j) / (L_j(b) + f_j)) - (cost(b) - cost(a))

L_j is the mean square residual at joint j on held-out fifths of the session, and f_j the form error that any
model leaves. nu_j is the number of rows over the design effect of the direction in which the sets differ, and
limited (Miller and Dunson 2019, JASA 114). The cost is ln(nu) / 2 per coefficient, the logarithm of the
number of alternatives (Chen and Chen 2008, Biometrika 95), the odds against each change, and the strain: the
cost of the random effects and of unusually large changes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from wearscope.closed_loop.intake.design_effect import JoinedBlocks
from wearscope.closed_loop.model.events import FITS
from wearscope.tracking.changes import BODY, Change
from wearscope.tracking.rows import RunRows, scatter_columns
from wearscope.tracking.structure import Belief, Structure

#: Prior scatter of healthy sessions, as a share of the joint's friction and of its whole torque; number of
#: sessions as which this prior counts.
PRIOR_FRICTION, PRIOR_TORQUE, _PRIOR_SESSIONS = 0.01, 0.003, 3.0
#: Prior scatter of each of the `scatter_columns`.
_PRIOR = (PRIOR_FRICTION, PRIOR_FRICTION, PRIOR_FRICTION, PRIOR_TORQUE, PRIOR_TORQUE)
#: No form is exact, so at most this many independent rows count, and the form error is this share of the mean
#: square without changes. Number of parts of a session that are held out in turn.
_MOST_ROWS, _FORM, _FOLDS = 250.0, 1e-4, 5
#: Rounds in which the scatter of healthy sessions is estimated.
_ROUNDS = 30
#: False-alarm rate of a session, over all joints and changes.
FALSE_ALARM_RATE = 0.01
#: Odds [nats] from which one explanation excludes another: 20 to 1.
SURE = 3.0
#: Degrees of freedom (Student's t) of the healthy parameters' error, and of the scatter of healthy sessions.
_DOF, _SCATTER_DOF = 50.0, 6.0
#: Usual RMS torque of a change: of friction, as a share of the joint's friction; of anything else, as a share
#: of the joint's torque.
_USUAL_FRICTION, _USUAL_TORQUE = 1.0, 0.5
#: Directions of the reference's error that are below this share of the noise, over all rows, are left out.
_KNOWN = 0.05


@dataclass(frozen=True, eq=False)
class Fit:
    """A set of changes fitted to a session.

    Attributes
    ----------
    changes : tuple of Change
    values, covariances : dict of str to ndarray
        Weights (m,) of each change and their covariance (m, m), by key.
    left : ndarray (R, n)
        Residual torque.
    held, fitted : ndarray (n,)
        Mean square residual on held-out rows, and on all rows.
    dof : float
        Number of weights that the rows determine.
    strain : float
        Cost [nats] of the random effects, and of changes by their usual size.
    """

    changes: tuple[Change, ...]
    values: dict[str, np.ndarray]
    covariances: dict[str, np.ndarray]
    left: np.ndarray
    held: np.ndarray
    fitted: np.ndarray
    dof: float
    strain: float

    def error(self, change: Change) -> np.ndarray:
        """Standard error (m,) of a change's weights."""
        return np.sqrt(np.maximum(np.diag(self.covariances[change.key]), 0.0))

    def p_value(self, change: Change) -> float:
        """p-value of the hypothesis that the change is zero (Wald's F)."""
        value, covariance = self.values[change.key], self.covariances[change.key]
        wald = value @ np.linalg.pinv(covariance, rcond=1e-10, hermitian=True) @ value
        return float(stats.f.sf(wald / len(value), len(value), _DOF))


class Evidence:
    """Rows of a session with the columns of all changes and random effects, and fits of sets of changes.

    Parameters
    ----------
    structure : Structure
    changes : sequence of Change
    belief : Belief
    payload_prior : ndarray (10,)
        Prior precision of a body's parameters.
    made : sequence of RunRows
    scatter : ndarray (k,), optional
        Standard deviation of each of `scatter_columns`; None leaves them out.
    of_temperature : bool
        Whether unknown temperatures, and their unknown influence, are random effects.
    level : float
        Prior probability that the session shows any change.
    """

    def __init__(
        self, structure: Structure, changes: Sequence[Change], belief: Belief, payload_prior: np.ndarray,
        made: Sequence[RunRows], scatter: np.ndarray | None = None, of_temperature: bool = True,
        level: float = FALSE_ALARM_RATE,
    ):  # fmt: skip
        self.structure, self.changes = structure, tuple(changes)
        #: Prior odds against each of the changes [nats].
        self.odds = float(np.log(max(len(self.changes), 1) / level))
        keep = np.concatenate([r.weights > 0 for r in made]).astype(float)
        self.keep = keep
        self.y = np.concatenate([r.target - r.columns @ belief.mean for r in made]) * keep
        self.at, count = {}, 0
        for change in changes:
            self.at[change.key] = np.arange(count, count + change.count)
            count += change.count
        self.z = np.concatenate([self._reduce_columns(r) for r in made]) * keep[:, :, None]
        covariance = belief.covariance
        if not of_temperature and structure.of_temperature.any():
            covariance = condition(covariance, structure.of_temperature)
        unsure = np.concatenate([r.columns @ _root(covariance) for r in made]) * keep[:, :, None]
        flat = (unsure / structure.scales.noise[:, None]).reshape(-1, unsure.shape[2])
        size, vector = np.linalg.eigh(flat.T @ flat)
        parts = [unsure @ vector[:, size > _KNOWN]]
        if of_temperature:
            parts.append(np.concatenate([r.unrecorded for r in made]) * keep[:, :, None])
        if scatter is not None:
            found = np.concatenate([scatter_columns(structure, r) for r in made])
            parts.append(found * scatter * keep[:, :, None])
        self.random = np.concatenate(parts, axis=2)
        self._known = parts[0].shape[2]
        starts, runs, first = [], [], 0
        for k, r in enumerate(made):
            starts.append(first + r.starts)
            runs += [k] * len(r.starts)
            first += len(r.target)
        self.blocks = JoinedBlocks(np.concatenate(starts), np.array(runs))
        block = np.searchsorted(self.blocks.starts, np.arange(first), side="right") - 1
        self._fold = block * _FOLDS // len(runs)
        self.count = np.maximum(keep.sum(axis=0), 1.0)
        self._penalty = np.concatenate(
            [*(self._usual(change, payload_prior) for change in changes), np.ones(self.random.shape[2])]
        )
        self.weigh(structure.scales.noise**2)

    def _reduce_columns(self, rows: RunRows) -> np.ndarray:
        """Regressors (M, n, K) of all changes along a run, after the common filter."""
        s, parts = rows.signals, [np.zeros((*rows.target.shape, 0))]
        bodies = s.rigid_body.inertial_regressor(s.q, s.v, s.a)
        parts += [rows.run.reduce_columns(change.columns(s, bodies)) for change in self.changes]
        return np.concatenate(parts, axis=2)

    def _usual(self, change: Change, payload_prior: np.ndarray) -> np.ndarray:
        """Prior precision of a change's weights."""
        if change.kind == BODY:
            return payload_prior[list(change.terms[0].subset)]
        scales, friction = self.structure.scales, any(t.effect.is_friction for t in change.terms)
        size = _USUAL_FRICTION * scales.friction if friction else _USUAL_TORQUE * scales.torque
        square = ((self.z[:, :, self.at[change.key]] / size[:, None]) ** 2).sum(axis=0)
        return np.asarray((square / self.count[:, None]).max(axis=0))

    def weigh(self, variance: np.ndarray) -> None:
        """Weigh the rows by a variance (n,) of the residual that includes the effect of autocorrelation."""
        self.variance, self.form = variance, np.zeros(self.structure.n)
        self._made: dict[tuple[str, ...], Fit] = {}
        x = np.concatenate([self.z, self.random], axis=2)
        weighted = x / variance[:, None]
        masks = [self._fold == f for f in range(_FOLDS)]
        self._gram = np.array([np.einsum("rjp,rjq->pq", weighted[m], x[m], optimize=True) for m in masks])
        self._score = np.array([np.einsum("rjp,rj->p", weighted[m], self.y[m]) for m in masks])
        self.form = _FORM * self.fit(()).held

    def fit(self, changes: Sequence[Change]) -> Fit:
        """Fit of a set of changes with all random effects; each set is fitted once."""
        own = tuple(sorted(changes, key=lambda c: c.key))
        name = tuple(c.key for c in own)
        if name not in self._made:
            self._made[name] = self._fit(own)
        return self._made[name]

    def _columns(self, changes: Sequence[Change]) -> np.ndarray:
        """Indices of the changes' columns, then of the random effects'."""
        own = [self.at[c.key] for c in changes]
        return np.concatenate([*own, self.z.shape[2] + np.arange(self.random.shape[2])]).astype(int)

    def _fit(self, changes: tuple[Change, ...]) -> Fit:
        """Fit of changes and random effects to all rows, and its residual on rows held out in turn."""
        at = self._columns(changes)
        k = len(at) - self.random.shape[2]
        z = self.z[:, :, at[:k]]
        gram, score = self._gram[:, at[:, None], at], self._score[:, at]
        total, goal, penalty = gram.sum(axis=0), score.sum(axis=0), self._penalty[at]
        held = np.empty_like(self.y)
        for f in range(_FOLDS):
            m = self._fold == f
            theta = invert(total - gram[f] + np.diag(penalty)) @ (goal - score[f])
            held[m] = self.y[m] - z[m] @ theta[:k] - self.random[m] @ theta[k:]
        inverse = invert(total + np.diag(penalty))
        theta = inverse @ goal
        left = self.y - z @ theta[:k] - self.random @ theta[k:]
        own = total[:k, :k]
        dof = float(np.trace(invert(own + np.diag(penalty[:k])) @ own)) if k else 0.0
        strain = self._strain(theta[k:]) + 0.5 * float(penalty[:k] @ theta[:k] ** 2)
        places = np.split(np.arange(k), np.cumsum([c.count for c in changes])[:-1]) if changes else []
        return Fit(
            changes,
            {c.key: theta[p] for c, p in zip(changes, places, strict=True)},
            {c.key: inverse[np.ix_(p, p)] for c, p in zip(changes, places, strict=True)},
            left,
            (held**2 * self.keep).sum(axis=0) / self.count,
            (left**2 * self.keep).sum(axis=0) / self.count,
            dof,
            strain,
        )

    def _strain(self, theta: np.ndarray) -> float:
        """Cost [nats] of the random effects' weights, whose prior has the tails of Student's t."""
        sure, far = theta[: self._known], theta[self._known :]
        total = _DOF * np.log1p(sure @ sure / _DOF) + _SCATTER_DOF * np.log1p(far**2 / _SCATTER_DOF).sum()
        return 0.5 * float(total)

    def rank(self, base: Sequence[Change], able: Sequence[Change]) -> list[Change]:
        """Changes ordered by their estimated gain when added to the set `base`, the largest first."""
        at = self._columns(base)
        total, goal = self._gram.sum(axis=0), self._score.sum(axis=0)
        inverse = invert(total[np.ix_(at, at)] + np.diag(self._penalty[at]))
        gains = []
        for change in able:
            own = self.at[change.key]
            cross = total[np.ix_(at, own)]
            rest = total[np.ix_(own, own)] + np.diag(self._penalty[own]) - cross.T @ inverse @ cross
            score = goal[own] - cross.T @ (inverse @ goal[at])
            gains.append(0.5 * float(score @ invert(rest) @ score) - 2.0 * len(own) - change.odds)
        return [able[k] for k in np.argsort(gains)[::-1]]

    def compare(self, a: Fit, b: Fit) -> float:
        """Log odds [nats] of set b over set a."""
        total, rows = 0.0, [2.0]
        for j in self.structure.moving:
            direction = a.left[:, j] - b.left[:, j]
            if float(direction @ direction) > 1e-18:
                better = a if a.fitted[j] < b.fitted[j] else b
                rows.append(self.rows(direction * better.left[:, j], j))
                total += 0.5 * rows[-1] * np.log((a.held[j] + self.form[j]) / (b.held[j] + self.form[j]))
        return total - self.cost(b, max(rows)) + self.cost(a, max(rows))

    def rows(self, score: np.ndarray, joint: int) -> float:
        """Number of independent rows that scores (R,) at a joint are worth, limited by `_MOST_ROWS`."""
        return self.blocks.count_rows(score, self.count[joint], _MOST_ROWS)

    def cost(self, fit: Fit, rows: float) -> float:
        """Cost of a set in nats; bodies on two links at once are rarer than on one."""
        more = max(sum(change.kind == BODY for change in fit.changes) - 1, 0)
        odds = sum(self.odds + change.odds for change in fit.changes)
        return 0.5 * fit.dof * np.log(rows) + fit.strain + odds + SURE * more

    def torque(self, fit: Fit, change: Change) -> np.ndarray:
        """Torque (R, n) of a change as fitted."""
        return np.asarray(self.z[:, :, self.at[change.key]] @ fit.values[change.key])

    def smallest(self, fit: Fit, change: Change, direction: np.ndarray) -> float:
        """Smallest multiple of a change's weights `direction` (m,) that the session would show.

        The change comes in addition to the set of changes in `fit`.
        """
        at, own, total = self._columns(()), self.at[change.key], self._gram.sum(axis=0)
        inverse = invert(total[np.ix_(at, at)] + np.diag(self._penalty[at]))
        onto = inverse @ (total[np.ix_(at, own)] @ direction)
        shown = self.z[:, :, own] @ direction - self.random @ onto
        square = (shown**2).sum(axis=0) / self.count
        rows = {j: self.rows(shown[:, j] * fit.left[:, j], j) for j in self.structure.moving}
        cost = self.odds + change.odds + 0.5 * change.count * np.log(max(rows.values()))

        def gain(size: float) -> float:
            left = [rows[j] * np.log1p(size**2 * square[j] / max(fit.held[j], 1e-300)) for j in rows]
            return 0.5 * sum(left) + self._strain(size * onto)

        low, high = 1e-9, 1e9
        if gain(high) < cost:
            return float("inf")
        for _ in range(60):
            middle = np.sqrt(low * high)
            low, high = (middle, high) if gain(middle) < cost else (low, middle)
        return float(high)

    def take_out(self) -> np.ndarray:
        """Residual (R, n) of a fit of all changes at once that is robust against outliers (Huber 1964)."""
        x = np.concatenate([self.z, self.random], axis=2)
        weight, theta = self.keep / self.variance, np.zeros(x.shape[2])
        for _ in range(FITS):
            weighted = x * weight[:, :, None]
            gram = np.einsum("rjp,rjq->pq", weighted, x, optimize=True)
            theta = invert(gram + np.diag(self._penalty)) @ np.einsum("rjp,rj->p", weighted, self.y)
            miss = np.abs(self.y - x @ theta)
            seen = np.where(self.keep > 0, miss, np.nan)
            scale = 1.4826 * np.nan_to_num(np.nanmedian(seen, axis=0), nan=1.0)
            weight = self.keep / self.variance * np.minimum(1.0, 2.0 * scale / np.maximum(miss, 1e-300))
        return np.asarray(self.y - x @ theta)


def prior_scatter(structure: Structure) -> np.ndarray:
    """Standard deviation of each of `scatter_columns` before any healthy session is seen."""
    return np.tile(_PRIOR, len(structure.moving))


def measure_scatter(
    structure: Structure, healthy: Sequence[Evidence], made: Sequence[Sequence[RunRows]]
) -> np.ndarray:
    """Standard deviation of each of `scatter_columns` between healthy sessions, each against the others.

    It is estimated by expectation and maximisation (Dempster, Laird and Rubin 1977, JRSS B 39). Each
    iteration divides a session's deviation between its scatter, by the present estimate, and the error of
    the others' prediction.

    Parameters
    ----------
    structure : Structure
    healthy : sequence of Evidence
        Evidence of each session, with the belief of the other sessions.
    made : sequence of sequence of RunRows
        Rows of each session.
    """
    prior = prior_scatter(structure)
    sums = []
    for evidence, rows in zip(healthy, made, strict=True):
        found = np.concatenate([scatter_columns(structure, r) for r in rows]) * evidence.keep[:, :, None]
        x = np.concatenate([found, evidence.random], axis=2)
        weighted = x / structure.scales.noise[:, None] ** 2
        gram = np.einsum("rjp,rjq->pq", weighted, x, optimize=True)
        sums.append((gram, np.einsum("rjp,rj->p", weighted, evidence.y)))
    scatter = prior
    for _ in range(_ROUNDS):
        square = _PRIOR_SESSIONS * prior**2
        for gram, score in sums:
            precision = np.ones(len(score))
            precision[: len(prior)] = scatter**-2
            inverse = invert(gram + np.diag(precision))
            square += ((inverse @ score) ** 2 + np.diag(inverse))[: len(prior)]
        scatter = np.sqrt(square / (_PRIOR_SESSIONS + len(sums)))
    return np.asarray(scatter)


def invert(matrix: np.ndarray, rcond: float = 1e-9) -> np.ndarray:
    """Pseudo-inverse of a positive semidefinite matrix that is scaled to a unit diagonal first.

    Directions whose eigenvalues are below `rcond` times the largest one are left out.
    """
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.linalg.pinv(matrix / np.outer(scale, scale), rcond=rcond, hermitian=True)
    return np.asarray(inverse / np.outer(scale, scale))


def condition(covariance: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Covariance (P, P) of normal variables given those of the mask `known` (P,), whose own becomes zero."""
    left = covariance.copy()
    cross = covariance[np.ix_(~known, known)]
    given = np.linalg.pinv(covariance[np.ix_(known, known)], rcond=1e-10, hermitian=True)
    left[np.ix_(~known, ~known)] -= cross @ given @ cross.T
    left[known] = 0.0
    left[:, known] = 0.0
    return left


def _root(covariance: np.ndarray) -> np.ndarray:
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    value, vector = np.linalg.eigh(covariance / np.outer(size, size))
    return np.asarray(size[:, None] * vector * np.sqrt(np.maximum(value, 0.0)))
