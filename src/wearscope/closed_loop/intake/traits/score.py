"""Score of a reading with its best machine (a set of terms), against another such pair.

    ln BF = sum_j nu_j / 2 * ln((L_j + f) / (L'_j + f)) - (cost' - cost)

- L_j: held-out squared error of a torque column, as a share of its variance; both pairs have the same
columns.
- f: form error, the share that a coarse dictionary leaves of any machine's torque.
- nu_j: rows over the design effect of the direction in which the two models differ, and no more than `ROWS`.
- cost: half the squares of the coefficients in units of their prior's standard deviation, ln(nu) / 2 per free
  coefficient, the logarithm of the number of alternatives, and the odds against the reading's traits.

It is the form of `inference.score`, on a dictionary that is small enough for many readings.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cached_property

import numpy as np

from wearscope.closed_loop.intake.traits.dictionary import (
    DRIVE,
    FREE,
    OWN,
    Columns,
    make_columns,
    scale_columns,
    scale_payload,
)
from wearscope.closed_loop.intake.traits.reading import Reading
from wearscope.closed_loop.intake.traits.rows import Rows
from wearscope.robots.dynamics import N_PARAMETERS

#: Form error, a share of a torque's variance; largest number of independent rows; nats that a term must gain.
FORM, ROWS, GAINS = 0.005, 100.0, 0.5
#: Iterations in which the torques are weighted by their residuals; largest number of moves of a climb, and of
#: terms that each move tries.
_TURNS, _MOVES, _TRIED = 3, 12, 3
#: Iterations that align the torques with the motion, and the step of their numerical slopes [s].
_ALIGNED, _SHORT = 6, 1e-4

#: Relative ridge on the diagonal, for columns that are equal to rounding.
_HELD = 1e-9
#: A coefficient counts where its effect is at least this share of the largest effect in its term.
_TOLD = 0.01
#: Share of a stated payload that may be missing at most; rounding error.
_EMPTIED = 1.05
_EPS = 100.0 * np.finfo(float).eps

Term = tuple[str, int]
#: Term of a load on the last link that is not stated.
PAYLOAD: Term = ("payload", -1)


class Fit:
    """Columns of a reading with their Gram matrices, and fits of machines (sets of terms) to them.

    Parameters
    ----------
    rows : Rows
    reading : Reading
    columns : Columns
    """

    def __init__(self, rows: Rows, reading: Reading, columns: Columns) -> None:
        self.rows, self.reading, self.columns = rows, reading, columns
        tested, joint = rows.tested, rows.joint_of(reading)
        self.joint = joint[tested]
        tau, some = rows.torque(reading)[:, tested], columns.pick(self.joint)
        self.names = np.array(OWN)[: some.own.shape[2]]
        shared, own, n = some.shared.shape[2], len(self.names), len(tested)
        counts, scale = rows.counts[:, tested], rows.scale[tested].copy()
        for k in np.flatnonzero(np.isin(tested, sorted(reading.crossed))):
            scale[k] = tau[counts[:, k], k].std()
        size = np.array(reading.size)[self.joint]
        sign, size = np.sign(size), np.abs(size)
        if not rows.doubted.all():  # the whole torque of these runs has another size, friction included
            sign, size = np.where(rows.doubted[:, None], sign / size, 1.0), np.ones(n)
        most = float(some.known.std(axis=0).max(initial=0.0))
        x = np.concatenate([some.shared * (size / scale)[:, None], scale_columns(some, scale, most)], axis=2)
        body = some.known * (size / scale) * counts
        self.x = np.ascontiguousarray((x * counts[:, :, None]).transpose(1, 0, 2))
        self.body, self.y = body.T, (sign * tau / scale * counts - body).T
        self.count = np.maximum(counts.sum(axis=0), 1)
        self.shared, self.soft = shared, columns.links + N_PARAMETERS
        # A soft gear's columns are scaled by their size at the joint where it is felt most.
        soft = self.x[:, :, self.soft : shared]
        soft /= np.sqrt((soft**2).sum(axis=1) / self.count[:, None]).max(axis=0, initial=0.0) + 1e-300
        self.index = [np.r_[np.arange(shared), shared + k * own + np.arange(own)] for k in range(n)]
        self.size = shared + n * own
        bodies = [run.signals.rigid_body for run in rows.prepared.runs]
        stated = max(body.payload.mass if body.payload else 0.0 for body in bodies)
        self.lightest = -_EMPTIED * stated / float(scale_payload(bodies[0])[0][0]) - _EPS
        self.signed = np.r_[np.zeros(shared, bool), np.tile(~np.isin(self.names, FREE), n)]
        self.always = np.r_[np.arange(shared) < columns.links, np.tile(np.arange(own) < DRIVE, n)]

    @cached_property
    def groups(self) -> dict[Term, np.ndarray]:
        """Indices of the coefficients of each term that a machine may have."""
        names, own = self.names, len(self.names)
        out: dict[Term, np.ndarray] = {PAYLOAD: np.arange(self.columns.links, self.soft)}
        for k, j in enumerate(self.joint.tolist()):
            if self.soft < self.shared:
                out["soft gear", j] = np.array([self.soft + k])
            for name in dict.fromkeys(names[DRIVE:].tolist()):
                if name != "balancer" or not self.rows.slides[j]:
                    out[name, j] = self.shared + k * own + np.flatnonzero(names == name)
        return out

    def count_free(self, term: Term) -> int:
        """Number of a term's coefficients that the motion determines at all."""
        at = self.groups[term]
        if term != PAYLOAD:
            return len(at)
        sizes = np.linalg.svd(self.total[:, at[:, None], at].sum(axis=0), compute_uv=False)
        return int(np.sum(sizes > _TOLD * sizes[0]))

    @cached_property
    def total(self) -> np.ndarray:
        """Gram matrix (K, k + 1, k + 1) of each torque's columns and the torque itself, over its rows."""
        return self._multiply(slice(None))

    def _multiply(self, at: slice | np.ndarray) -> np.ndarray:
        z = np.concatenate([self.x[:, at], self.y[:, at, None]], axis=2)
        return np.asarray(z.transpose(0, 2, 1) @ z / self.count[:, None, None])

    @cached_property
    def folds(self) -> list[np.ndarray]:
        """Gram matrices of the rows of each fold; see `total`."""
        return [self._multiply(self.rows.fold == fold) for fold in np.unique(self.rows.fold)]

    def normal(self, grams: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix and right-hand side of all coefficients, with priors of standard deviation 1."""
        a, b = np.eye(self.size), np.zeros(self.size)
        for gram, w, at in zip(grams, weight, self.index, strict=True):
            a[at[:, None], at] += w * gram[:-1, :-1]
            b[at] += w * gram[:-1, -1]
        return a, b

    def solve(self, grams: np.ndarray, weight: np.ndarray, active: np.ndarray) -> np.ndarray:
        """Coefficients of the active columns; those of friction and inertia are not negative.

        The shared columns are eliminated first.
        """
        shared, own, n = self.shared, len(self.names), len(weight)
        w, x = grams * weight[:, None, None], np.zeros(self.size)
        at, on = np.flatnonzero(active[:shared]), np.flatnonzero(active[shared:])
        both = w[:, at, shared:-1].transpose(1, 0, 2).reshape(len(at), n * own)[:, on]
        whole = np.eye(len(at)) + w[:, at[:, None], at].sum(axis=0)
        whole[np.diag_indices(len(at))] *= 1.0 + _HELD
        taken = np.linalg.solve(whole, np.column_stack([both, w[:, at, -1].sum(axis=0)]))
        drives = np.zeros((n, own, n, own))
        drives[range(n), :, range(n)] = w[:, shared:-1, shared:-1]
        a = drives.reshape(n * own, n * own)[on[:, None], on] + np.eye(len(on)) - both.T @ taken[:, :-1]
        a[np.diag_indices(len(on))] *= 1.0 + _HELD
        b = w[:, shared:-1, -1].ravel()[on] - both.T @ taken[:, -1]
        signed, used, found = self.signed[shared:][on], np.ones(len(on), bool), np.zeros(len(on))
        while True:
            k = np.flatnonzero(used)
            found[:] = 0.0
            found[k] = np.linalg.solve(a[k[:, None], k], b[k])
            bad = signed & (found < 0.0)
            if not bad.any():
                break
            used &= ~bad
        x[at], x[shared + on] = taken[:, -1] - taken[:, :-1] @ found, found
        if x[self.columns.links] < self.lightest:  # no machine carries less than nothing
            other = active.copy()
            other[self.groups[PAYLOAD]] = False
            return self.solve(grams, weight, other)
        return x

    def step(self, slopes: np.ndarray) -> np.ndarray:
        """Changes (p,) of numbers on which the torques depend by `slopes` (p, K, N), next to all columns."""
        _, _, weight = self.settle(np.ones(self.size, bool), 2)
        a, b = self.normal(self.total, weight)
        cross, own, pull = np.zeros((self.size, len(slopes))), 0.0, 0.0
        parts = zip(self.x, self.y, self.index, slopes.transpose(1, 0, 2), weight / self.count, strict=True)
        for x, y, at, slope, w in parts:
            cross[at] += w * x.T @ slope.T
            own, pull = own + w * slope @ slope.T, pull + w * slope @ y
        taken = np.linalg.solve(a, np.column_stack([cross, b]))
        # Nothing changes for a run in which nothing moves.
        return np.linalg.lstsq(own - cross.T @ taken[:, :-1], cross.T @ taken[:, -1] - pull, rcond=None)[0]

    def losses(self, x: np.ndarray, grams: np.ndarray) -> np.ndarray:
        """Unexplained shares of each torque's variance for given coefficients."""
        z = np.column_stack([x[np.array(self.index)], np.full(len(self.index), -1.0)])
        # Where the body needs far more torque than there is, a small difference is rounding and no good fit.
        least = _EPS * (np.abs(z)[:, None] @ np.abs(grams) @ np.abs(z)[:, :, None])
        return np.maximum(z[:, None] @ grams @ z[:, :, None], least).ravel()

    def settle(self, active: np.ndarray, turns: int = _TURNS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients, unexplained shares (K,) of the torques, and the weights (K,) that these imply."""
        loss = np.full(len(self.x), 0.05)
        for _ in range(turns):
            weight = ROWS / (np.minimum(loss, 1.0) + FORM)
            x = self.solve(self.total, weight, active)
            loss = self.losses(x, self.total)
        return x, loss, ROWS / (np.minimum(loss, 1.0) + FORM)

    def look(self) -> float:
        """First score of a reading [nats, lower is better], with all terms, each held by its prior."""
        x, loss, _ = self.settle(np.ones(self.size, bool), 2)
        return float(ROWS / 2 * np.log(loss + FORM).sum() + 0.5 * x @ x) + self.reading.nats

    def leave_plain(self) -> np.ndarray:
        """Unexplained shares (K,) with links, inertia and every kind of friction, without other forces."""
        plain = np.tile(~np.isin(self.names, FREE[1:]), len(self.x))
        return self.settle(np.r_[self.always[: self.shared], plain])[1]

    def size_alone(self, k: int) -> float:
        """Ratio of the k-th torque to what the body needs, fitted to this torque alone along with a drive."""
        at = self.rows.doubted
        drive, body = self.x[k][at, self.shared : self.shared + DRIVE], self.body[k][at]
        y = self.y[k][at] + body
        both = [np.column_stack([body, drive[:, first:]]) for first in (0, 1)]
        found = [np.linalg.lstsq(x, y, rcond=None)[0] for x in both]
        left = [float(np.mean((y - x @ one) ** 2)) for x, one in zip(both, found, strict=True)]
        # Where the columns of the drive's inertia and of the body are alike, the body gets all inertia.
        return float(found[left[1] < left[0] + FORM * float(np.mean(y**2))][0])

    def model(self, terms: Iterable[Term]) -> "Model":
        """Model of a machine with the given terms, fitted."""
        terms, active = frozenset(terms), self.always.copy()
        for term in terms:
            active[self.groups[term]] = True
        x, loss, weight = self.settle(active)
        held = sum(self.losses(self.solve(self.total - g, weight, active), g) for g in self.folds)
        return Model(self, terms, x, loss, np.asarray(held))

    def climb(self) -> "Model":
        """The best machine of a greedy search that adds, drops and exchanges terms until no move gains."""
        now = self.model(())
        for _ in range(_MOVES):
            tried = [now.terms | {one} for one in now.list_hopes()[:_TRIED]]
            tried += [now.terms - {one} for one in now.terms]
            best = now.improve(tried)
            if best is now:
                near = ((t, u) for t in now.terms for u in self.groups if u not in now.terms)
                near = ((t, u) for t, u in near if t[1] == u[1] or "payload" in (t[0], u[0]))
                best = now.improve([now.terms - {t} | {u} for t, u in near])
            if best is now:
                break
            now = best
        return now


class Model:
    """A reading with a fitted machine.

    Attributes
    ----------
    fit : Fit
    terms : frozenset of (str, int)
    x : ndarray
        Coefficients.
    left, held : ndarray (K,)
        Unexplained share of each torque's variance, on all rows and on held-out rows.
    """

    def __init__(
        self, fit: Fit, terms: frozenset[Term], x: np.ndarray, left: np.ndarray, held: np.ndarray
    ) -> None:
        self.fit, self.terms, self.x, self.left, self.held = fit, terms, x, left, held
        free = sum(fit.count_free(term) for term in terms)
        alternatives = len(terms) * np.log(max(len(fit.groups), 1))
        self.cost = 0.5 * free * np.log(ROWS) + alternatives + 0.5 * float(x @ x) + fit.reading.nats

    @property
    def reading(self) -> Reading:
        """The reading of the columns."""
        return self.fit.reading

    @property
    def need(self) -> float:
        """Upper bound of what any other reading can gain [nats]."""
        return float(ROWS / 2 * np.log(self.held / FORM + 1.0).sum()) + self.cost - self.reading.nats

    def own(self, k: int) -> np.ndarray:
        """Coefficients (len(OWN),) of the k-th torque's own columns."""
        count = len(self.fit.names)
        start = self.fit.shared + k * count
        return self.x[start : start + count]

    def leave_by_run(self) -> np.ndarray:
        """Largest unexplained share (R,) of any torque's variance in each run."""
        rows, shares = self.fit.rows, []
        number = np.unique(rows.run, return_inverse=True)[1]
        for k, c in enumerate(rows.tested):
            at = rows.counts[:, c]
            count = np.maximum(np.bincount(number, at), 1)
            y = self.fit.y[k] + self.fit.body[k]
            spread = np.bincount(number, y**2) / count - (np.bincount(number, y) / count) ** 2
            left = np.bincount(number, self.leave(k) ** 2) / count
            shares.append(np.divide(left, spread, out=0.0 * left, where=spread > _EPS))
        return np.asarray(np.max(shares, axis=0))

    def measure_friction(self, k: int) -> float:
        """Share of the k-th torque's variance that friction makes."""
        kinds = ("Coulomb", "viscous", "friction", "damping")
        own = self.own(k) * [any(kind in name for kind in kinds) for name in self.fit.names]
        return float((self.fit.x[k][:, self.fit.shared :] @ own).var())

    def find_by_run(self, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients (R, m) of some columns if each run had its own, and their covariance (R, m, R, m)."""
        fit, number = self.fit, np.unique(self.fit.rows.run, return_inverse=True)[1]
        rest = np.setdiff1d(np.flatnonzero(self.x), some)
        own = number[:, None] == np.arange(number.max() + 1)
        shape, grams = (own.shape[1], len(some)), []
        for x, y, at, count in zip(fit.x, fit.y, fit.index, fit.count, strict=True):
            whole = np.zeros((len(x), fit.size))
            whole[:, at] = x
            split = (own[:, :, None] * whole[:, None, some]).reshape(len(x), -1)
            z = np.column_stack([whole[:, rest], split, y])
            grams.append(z.T @ z / count)
        every, left = np.stack(grams), self.left
        for _ in range(_TURNS):
            weight = ROWS / (np.minimum(left, 1.0) + FORM)
            total = np.tensordot(weight, every, 1)
            inverse = np.linalg.inv(total[:-1, :-1] + np.eye(len(total) - 1))
            found = np.append(inverse @ total[:-1, -1], -1.0)
            left = np.maximum(np.einsum("i,kij,j->k", found, every, found), 0.0)
        at = slice(len(rest), -1)
        return found[at].reshape(shape), inverse[len(rest) :, len(rest) :].reshape(*shape, *shape)

    def leave(self, k: int) -> np.ndarray:
        """Residual (N,) of the k-th torque, over its spread."""
        return np.asarray(self.fit.y[k] - self.fit.x[k] @ self.x[self.fit.index[k]])

    def over(self, other: "Model") -> float:
        """Log Bayes factor [nats] of this model over another."""
        total = other.cost - self.cost
        for k in range(len(self.held)):
            a, b = other.leave(k), self.leave(k)
            product = (a - b) * (b if self.held[k] < other.held[k] else a)
            rows = self.fit.rows.blocks.count_rows(product, self.fit.count[k], ROWS)
            total += rows / 2 * float(np.log((other.held[k] + FORM) / (self.held[k] + FORM)))
        return total

    def list_hopes(self) -> list[Term]:
        """Terms that may gain, best first, by their gain on the fitted rows with all others refitted."""
        fit, found = self.fit, []
        a, b = fit.normal(fit.total, ROWS / (np.minimum(self.held, 1.0) + FORM))
        on = np.flatnonzero(self.x != 0.0)
        inverse = np.linalg.inv(a[on[:, None], on])
        for term, at in fit.groups.items():
            if term not in self.terms:
                cross = a[on[:, None], at]
                left = b[at] - cross.T @ (inverse @ b[on])
                own = a[at[:, None], at] - cross.T @ inverse @ cross
                x = np.linalg.solve(own, left)
                x = np.where(fit.signed[at], np.maximum(x, 0.0), x)
                gain = float(x @ (left - 0.5 * own @ x)) - 0.5 * len(at) * np.log(ROWS)
                found.append((gain, term))
        return [term for gain, term in sorted(found, reverse=True) if gain > 0.0]

    def improve(self, tried: Iterable[frozenset[Term]]) -> "Model":
        """The best model among machines with other terms; this model where none gains."""
        models = [self.fit.model(terms) for terms in tried]
        best = max(models, key=lambda one: one.over(self), default=self)
        return best if best is not self and best.over(self) > GAINS else self


class Weighing:
    """Fits of readings to some rows; their columns and first scores are kept.

    Parameters
    ----------
    rows : Rows
    coarse : bool
        Whether the columns are coarse; see `make_columns`.
    """

    def __init__(self, rows: Rows, coarse: bool = False) -> None:
        self.rows, self.coarse = rows, coarse
        self._columns: dict[tuple, Columns] = {}
        self._looks: dict[Reading, float] = {}

    def fit(self, reading: Reading) -> Fit:
        """Fit of a reading; readings that differ only in the torques share their columns."""
        if reading.moves not in self._columns:
            if len(self._columns) > 64:
                self._columns.pop(next(iter(self._columns)))
            self._columns[reading.moves] = make_columns(self.rows, reading, self.coarse)
        return Fit(self.rows, reading, self._columns[reading.moves])

    def align(self, make: Callable[[np.ndarray], Reading], starts: np.ndarray, most: float) -> Reading:
        """Best reading that moves the torques by times (p,) up to `most` [s], from the best start (k, p).

        Gauss-Newton steps, with all coefficients of the machine projected out.
        """
        x, tried = min(starts, key=lambda one: self.look(make(one))), []
        for _ in range(_ALIGNED):
            tried.append(make(x))
            now, delay = self.fit(tried[-1]), self.rows.delay_of(tried[-1])
            later = replace(tried[-1], delay=tuple(one + _SHORT for one in tried[-1].delay))
            slope = (self.fit(later).y - now.y) / _SHORT
            shapes = np.array([self.rows.delay_of(make(x + one)) - delay for one in np.eye(len(x))])
            x = np.clip(x + now.step(slope * shapes[:, None]), -most, most)
        return min(tried, key=lambda one: self.look(one) - one.nats)

    def look(self, reading: Reading) -> float:
        """First score of a reading [nats, lower is better]; see `Fit.look`."""
        if reading not in self._looks:
            self._looks[reading] = self.fit(reading).look()
        return self._looks[reading]
