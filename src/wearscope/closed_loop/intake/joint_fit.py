"""One linear fit of all joints' torques that has what machines have: what a reading of the columns leaves.

The rigid body is shared by the joints: its links' inertial parameters may differ from the stated ones, at a
cost. Each joint has a drive of its own: rotor inertia, Coulomb and viscous friction, friction that grows with
the load or falls with the speed, all of which take power and never give it, and an offset. Torques count in
units of their own spread, so that what is left of a joint is the share of its variance.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from wearscope.closed_loop.intake.products import DRIVE, FALLS, NONE, Fit, Products
from wearscope.robots.dynamics import N_PARAMETERS, RigidBody

#: Share of a link's own parameters by which they may differ from the stated ones at the fit's cost, trusted
#: or approximate; share of the robot's mass that every link and the last may carry undeclared at that cost.
_SLACK = {"trusted": 0.15, "approximate": 0.25}
_CARRIED, _LOADED = 0.01, 0.05
#: Fewest rows of a joint that say something.
LEAST_ROWS = 30
#: Share of a torque's variance that a reading removes at least.
WORTH = 0.05
#: What one reading leaves is clearly less where it is this share of what another does, and so much less.
_CLEAR, _LEAST = 0.3, 0.005


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
    def sprung(self) -> Products:
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
            falls = [np.exp(-speed / share) for share in FALLS]
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
    def products(self) -> Products:
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
    def fitted(self) -> Fit:
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
    """Deviation (10 n,) of each inertial parameter that has the cost of one."""
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
