"""One linear fit of all joints' torques that has what machines have: what a reading of the columns leaves.

The rigid body is shared by the joints: its links' inertial parameters may differ from the stated ones, at a
cost. Each joint has a drive of its own: rotor inertia, Coulomb and viscous friction, friction that grows with
the load or falls with the speed, all of which take power and never give it, and an offset. Torques count in
units of their own spread, so that what is left of a joint is the share of its variance.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy import linalg, optimize

from wearscope.robots.dynamics import N_PARAMETERS, RigidBody

#: Speeds over which friction falls, over the largest one.
_FALLS = (0.05, 0.3)
#: Columns of a drive, each of which has a coefficient of zero or more; `FRICTION` of them take power.
_FALLING = tuple(f"falling {k}" for k in _FALLS)
DRIVE = ("inertia", "Coulomb", "viscous", *_FALLING, "load", *(f"load {one}" for one in _FALLING))
FRICTION = slice(1, len(DRIVE))
#: Share of a link's own parameters by which they may differ from the stated ones at a cost of `_COST`
#: shares of variance, trusted or approximate; share of the robot's mass that every link and the last may
#: carry undeclared at the same cost.
_SLACK = {"trusted": 0.15, "approximate": 0.25}
_COST, _CARRIED, _LOADED = 0.02, 0.01, 0.05
#: Fewest rows of a joint that say something.
LEAST_ROWS = 30
#: Share of a torque's variance that a reading removes at least.
WORTH = 0.05
#: What the stated reading must leave for others to be asked, in shares of a torque's variance.
DOUBTFUL = 0.015
#: Share of a torque's variance that is none.
NONE = 0.01
#: What one reading leaves is clearly less where it is this share of what another does, and so much less.
_CLEAR, _LEAST = 0.3, 0.005
_HELD = 1e-9


def is_clearly_less(total: float, other: float, by: float) -> bool:
    """Whether a reading leaves less than another by a share of a torque's variance, or next to nothing."""
    return total < other - by or (total < _CLEAR * other and total < other - _LEAST)


@dataclass(frozen=True)
class Rows:
    """Rows of the runs as some reading has them; arrays are (N, n).

    Attributes
    ----------
    q, v, a, sign, tau : ndarray
        At the common bandwidth; `sign` is the direction of motion.
    counts : ndarray of bool
        Rows that count for a joint.
    run : ndarray (N,) of int
        Run of each row.
    bodies : tuple of RigidBody
        By run, with the payload that it declares.
    inertia, top : ndarray (n,)
        Declared rotor inertia; largest speed.
    inertials : str
        ``trusted`` or ``approximate``.
    gravity : float
        Factor of the stated gravity.
    springs : bool
        Whether each joint may have any torque that is a line, sine and cosine of its own position.
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    sign: np.ndarray
    tau: np.ndarray
    counts: np.ndarray
    run: np.ndarray
    bodies: tuple[RigidBody, ...]
    inertia: np.ndarray
    top: np.ndarray
    inertials: str
    gravity: float = 1.0
    springs: bool = False

    def is_worth(self, total: float, any_size: bool = False) -> bool:
        """Whether a reading leaves clearly less than springs and balancers of all joints would."""
        return is_clearly_less(total, self.sprung.miss(any_size), WORTH)

    def rivals_springs(self, total: float) -> bool:
        """Whether a reading does about as well as springs and balancers of all joints would."""
        return total < 2.0 * self.sprung.fit().total + NONE

    @cached_property
    def sprung(self) -> "Products":
        """What a fit with springs needs."""
        other = replace(self, springs=True)
        other.__dict__.update({"slack": self.slack, "known": self.known})
        return other.products

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.q.shape[1]

    def pick(self, at: np.ndarray) -> "Rows":
        """Some of the rows."""
        parts = {name: getattr(self, name)[at] for name in ("q", "v", "a", "sign", "tau", "counts", "run")}
        other = replace(self, **parts)
        for name in {"slack", "known"} & set(self.__dict__):
            other.__dict__[name] = self.__dict__[name][at]
        return other

    def thin(self, most: int) -> "Rows":
        """Rows enough for a first look."""
        return self.pick(np.arange(0, len(self.q), max(1, len(self.q) // most)))

    def times(self, factor: np.ndarray, *names: str) -> "Rows":
        """Columns of the joints by a factor (n,)."""
        return replace(self, **{name: getattr(self, name) * factor for name in names})

    def with_slack(self, slack: np.ndarray) -> "Rows":
        """The same rows with another regressor of the links' parameters (N, n, P)."""
        other = replace(self)
        other.__dict__["slack"] = slack
        return other

    @cached_property
    def slack(self) -> np.ndarray:
        """Regressor (N, n, P) of the links' parameters."""
        body = self.bodies[0]
        if self.gravity != 1.0:
            body = body.with_gravity((self.gravity * np.array(body.gravity)).tolist())
        return body.inertial_regressor(self.q, self.v, self.a)

    @cached_property
    def known(self) -> np.ndarray:
        """Torque of the stated rigid body, payload and rotors (N, n)."""
        known = self.inertia * self.a
        for run in np.unique(self.run).tolist():
            at, body = self.run == run, self.bodies[run]
            links = body.inertial_parameters
            if body.payload is not None:
                links[-N_PARAMETERS:] += body.payload.parameters
            known[at] += self.slack[at] @ links
        return known

    def with_torques(self, tau: np.ndarray) -> "Rows":
        """The same motion with other torques (N, n)."""
        other = replace(self, tau=tau)
        other.__dict__.update(slack=self.slack, known=self.known, columns=self.columns)
        return other

    @cached_property
    def columns(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Columns of each joint less their mean (K, U), their places among all, and their products (P, P).

        In the order of links, drive, stated body; links that do not act on a joint have none there.
        """
        size = self.slack.shape[2] + len(DRIVE) + 1
        made = []
        for j in range(self.n):
            at = self.counts[:, j]
            if at.sum() < LEAST_ROWS:
                made.append((np.zeros((0, 0)), np.zeros(0, dtype=int), np.zeros((size, size))))
                continue
            slack = self.slack[at, j]
            acts = np.flatnonzero(slack.any(axis=0))
            known = self.known[at, j]
            sign, load = self.sign[at, j], self.sign[at, j] * np.abs(known)
            speed = np.abs(self.v[at, j]) / max(self.top[j], 1e-300)
            falls = [np.exp(-speed / share) for share in _FALLS]
            friction = [sign, self.v[at, j], *(sign * f for f in falls), load, *(load * f for f in falls)]
            x = self._take_out(np.column_stack([slack[:, acts], self.a[at, j], *friction, known]), j)
            places, products = np.append(acts, np.arange(slack.shape[1], size)), np.zeros((size, size))
            products[np.ix_(places, places)] = x.T @ x
            made.append((x, places, products))
        return made

    def _take_out(self, columns: np.ndarray, joint: int) -> np.ndarray:
        """Columns (K, P) of a joint less their mean, and less what its springs may give."""
        if not self.springs:
            return np.asarray(columns - columns.mean(axis=0))
        q = self.q[self.counts[:, joint], joint]
        basis = np.linalg.qr(np.column_stack([np.ones(len(q)), q, np.sin(q), np.cos(q)]))[0]
        return np.asarray(columns - basis @ (basis.T @ columns))

    @cached_property
    def products(self) -> "Products":
        """What a fit needs of these rows."""
        scale, grams, units = np.zeros(self.n), [], self._units
        for j, (x, places, own) in enumerate(self.columns):
            y = self.tau[self.counts[:, j], j]
            y = y - y.mean() if len(y) else y
            if not len(x) or not y.std() > 0.0:
                grams.append(np.zeros((0, 0)))
                continue
            scale[j] = y.std()
            y = self._take_out(y[:, None], j)[:, 0]
            cross = np.zeros(len(own))
            cross[places] = x.T @ y
            gram = np.block([[own, cross[:, None]], [cross[None, :], np.array([[y @ y]])]])
            grams.append(gram * np.outer(units, units) / (len(y) * scale[j] ** 2))
        return Products(grams, scale, len(units) - len(DRIVE) - 2)

    @cached_property
    def fitted(self) -> "Fit":
        """Fit of all joints."""
        return self.products.fit()

    @property
    def _units(self) -> np.ndarray:
        """Units of the columns of links, drive, stated body and torque."""
        return np.append(_deviations(self.bodies[0], self.inertials), np.ones(len(DRIVE) + 2))

    def leave(self, blocks: np.ndarray) -> np.ndarray:
        """What the fit of all rows leaves in blocks of them, (B, n), in shares of each torque's variance.

        Parameters
        ----------
        blocks : ndarray (N,) of int
        """
        out = np.zeros((blocks.max() + 1, self.n))
        for j, found in self.fitted.found.items():
            at, (x, places, _) = self.counts[:, j], self.columns[j]
            y = self._take_out(self.tau[at, j][:, None], j)[:, 0]
            own = np.append(found, 1.0) * self._units[:-1]
            errors = (y - x @ own[places]) / self.products.scale[j]
            out[:, j] = np.bincount(blocks[at], errors**2, len(out)) / at.sum()
        return out


@lru_cache(maxsize=64)
def _deviations(body: RigidBody, inertials: str) -> np.ndarray:
    """Deviation (10 n,) of each inertial parameter that costs `_COST`."""
    links = body.inertial_parameters.reshape(-1, N_PARAMETERS)
    share, total = _SLACK[inertials], float(links[:, 0].sum())
    points = body.joint_origins(np.zeros(body.n))[0]
    arms = np.linalg.norm(np.diff(points[1:], axis=0), axis=1)
    radii = np.linalg.norm(links[:, 1:4], axis=1) / np.maximum(links[:, 0], 1e-300)
    length = max(float(np.median(np.maximum(arms, radii))), 1e-3)
    out = np.empty_like(links)
    for k, link in enumerate(links):
        carried = (_LOADED if k == len(links) - 1 else _CARRIED) * total
        out[k, 0] = share * link[0] + carried
        out[k, 1:4] = share * np.linalg.norm(link[1:4]) + carried * length
        out[k, 4:] = share * np.abs(link[4:]).max() + carried * length**2
    return out.ravel()


@dataclass(frozen=True)
class Fit:
    """What a fit of all joints leaves.

    Attributes
    ----------
    left : ndarray (n,)
        Share of each torque's variance; NaN where a joint says nothing.
    cost : float
        Of links that differ from the stated ones.
    friction : ndarray (n,)
        Share of the variance that friction makes.
    found : dict of int to ndarray
        By joint, coefficients of its links over what costs `_COST`, and of its drive.
    """

    left: np.ndarray
    cost: float
    friction: np.ndarray
    found: dict[int, np.ndarray]

    @property
    def total(self) -> float:
        """Of all joints, and the links' cost."""
        return float(np.nansum(self.left)) + self.cost

    @property
    def is_doubtful(self) -> bool:
        """Whether enough is left for another reading to be asked for."""
        return self.total >= DOUBTFUL


@dataclass(frozen=True)
class Products:
    """Products of the columns of each joint: links, drive, stated body, torque.

    Attributes
    ----------
    grams : list of ndarray
        By joint, over the torque's variance; empty where a joint says nothing.
    scale : ndarray (n,)
        Spread of the torques.
    size : int
        Number of the links' columns, each over what costs `_COST`.
    """

    grams: list[np.ndarray]
    scale: np.ndarray
    size: int

    @property
    def heard(self) -> list[int]:
        """Joints that say something."""
        return [j for j, gram in enumerate(self.grams) if gram.size]

    def resize(self, size: np.ndarray) -> "Products":
        """Products of torques divided by a size (n,), -1 where turned round."""
        grams = []
        for gram, one in zip(self.grams, size.tolist(), strict=True):
            scale = np.append(np.full(max(len(gram) - 1, 0), one), 1.0)[: len(gram)]
            grams.append(gram * np.outer(scale, scale))
        return replace(self, grams=grams, scale=self.scale / np.abs(size))

    def run_backwards(self) -> "Products":
        """Products of friction that gives power."""
        p, d = self.size, len(DRIVE)
        sign = np.ones(p + d + 2)
        sign[p : p + d][FRICTION] = -1.0
        return replace(
            self, grams=[gram * np.outer(sign, sign) if gram.size else gram for gram in self.grams]
        )

    def fit(self) -> Fit:
        """Fit all joints at once."""
        n, p, d = len(self.grams), self.size, len(DRIVE)
        heard = self.heard
        links = np.diag(np.full(p, _COST))
        cross, drive = np.zeros((p, d * len(heard))), np.zeros((d * len(heard), d * len(heard)))
        right_links, right = np.zeros(p), np.zeros(d * len(heard))
        made = []
        for k, j in enumerate(heard):
            part, at = self.grams[j], slice(d * k, d * (k + 1))
            # Torque less the stated body.
            b = part[:, -1] - part[:, -2]
            links += part[:p, :p]
            cross[:, at] = part[:p, p : p + d]
            drive[at, at] = part[p : p + d, p : p + d]
            right_links += b[:p]
            right[at] = b[p : p + d]
            made.append((part, b, float(b[-1] - b[-2])))
        links += _HELD * float(np.diag(links).max()) * np.eye(p)
        factor = linalg.cho_factor(links)
        solved = linalg.cho_solve(factor, np.column_stack([cross, right_links]))
        found = _solve_non_negative(drive - cross.T @ solved[:, :-1], right - cross.T @ solved[:, -1])
        moved = solved[:, -1] - solved[:, :-1] @ found
        left, friction, every = np.full(n, np.nan), np.zeros(n), dict[int, np.ndarray]()
        for k, j in enumerate(heard):
            part, b, whole = made[k]
            own = found[d * k : d * (k + 1)]
            z = every[j] = np.concatenate([moved, own])
            # A body that needs far more torque than there is cancels to rounding errors, which are no fit.
            rounding = len(z) * np.finfo(float).eps * whole
            left[j] = max(whole - 2 * z @ b[: p + d] + z @ part[: p + d, : p + d] @ z, rounding)
            rubs = own[FRICTION]
            friction[j] = rubs @ part[p : p + d, p : p + d][FRICTION, FRICTION] @ rubs
        return Fit(left, _COST * float(moved @ moved), friction, every)

    def miss(self, any_size: bool = False) -> float:
        """What all joints leave, with torques as they are or each of any size."""
        return self.any_size if any_size else self.fit().total

    @property
    def any_size(self) -> float:
        """What each joint by itself leaves, with a body of any size or none."""
        factor, left, without = self.fit_sizes()
        return float(np.nansum(np.where(factor > 0.0, np.minimum(left, without), without)))

    def fit_sizes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Each joint by itself with a torque of any size, also turned round.

        A drive's inertia takes part only in what the body leaves of the torque: where both move alike, no
        fit tells how much each has, and the factor is that of the declared body alone.

        Returns
        -------
        factor, left, without : ndarray (n,)
            Torque over what the body needs, negative where the torque is turned round, its friction with it;
            share of the variance that is left with it, and without a body.
        """
        n, p, d = len(self.grams), self.size, len(DRIVE)
        factor, left, without = (np.full(n, np.nan) for _ in range(3))
        for j in self.heard:
            gram = self.grams[j][p:, p:]
            without[j] = _left(gram, np.arange(d), 1.0)[0]
            left[j] = np.inf
            for way in (1.0, -1.0):
                one, found = _left(gram, np.arange(d + 1), way)
                plain, held = _left(gram, np.arange(1, d + 1), way)
                none = _left(gram, np.arange(1, d), way)[0]
                size = held[-1] if plain - one < NONE * (none - one) else found[-1]
                if one < left[j]:
                    left[j], factor[j] = one, way * size
        return factor, left, without


def _left(gram: np.ndarray, picked: np.ndarray, sign: float) -> tuple[float, np.ndarray]:
    a, b = gram[np.ix_(picked, picked)], sign * gram[picked, -1]
    found = _solve_non_negative(a, b)
    return float(max(gram[-1, -1] - 2 * found @ b + found @ a @ found, 0.0)), found


def _solve_non_negative(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Least x' a x - 2 x' b with x >= 0, for a (K, K) without negative eigenvalues."""
    size = np.sqrt(np.diag(a))
    some = np.flatnonzero(size > 1e-8 * size.max(initial=0.0))
    out = np.zeros(len(b))
    if len(some):
        one, right = a[np.ix_(some, some)] / np.outer(size[some], size[some]), b[some] / size[some]
        try:
            root = np.linalg.cholesky(one + _HELD * np.eye(len(one))).T
        except np.linalg.LinAlgError:  # by rounding, of columns that say next to nothing
            values, vectors = linalg.eigh(one)
            root = np.sqrt(np.maximum(values, 0.0) + _HELD)[:, None] * vectors.T
        out[some] = optimize.nnls(root, np.linalg.solve(root.T, right))[0] / size[some]
    return out
