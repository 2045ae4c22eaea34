"""One linear fit of all joints' torques that has what machines have: what a reading of the columns leaves.

The rigid body is shared by the joints: its links' inertial parameters may differ from the stated ones, at a
cost. Each joint has a drive of its own: rotor inertia, Coulomb and viscous friction, friction that grows with
the load or falls with the speed, all of which take power and never give it, and an offset. Torques count in
units of their own spread, so that what is left of a joint is the share of its variance.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from wearscope.closed_loop.intake.products import FALLS, NONE, Fit, Products
from wearscope.robots.dynamics import N_PARAMETERS, RigidBody

#: Share of a link's own parameters by which they may differ from the stated ones at the fit's cost, trusted
#: or approximate; share of the robot's mass that every link and the last may carry undeclared at that cost,
#: and that a payload may have.
_SLACK = {"trusted": 0.15, "approximate": 0.25}
_CARRIED, _LOADED, _PAYLOAD = 0.01, 0.05, 3.0
#: Share of a payload's mass that the torques tell, at least; of the stated one that may be missing, at most.
_TOLD, _EMPTIED = 0.9, 1.05
#: Size of what a way of the links' parameters does, over the most that one does, below which it does nothing.
_ACTS = 1e-9
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
    gravity : tuple of float, optional
        In the base frame, in place of the stated one [m/s^2].
    springs : bool
        Whether each joint may have any torque that is a line, sine and cosine of its own position.
    loaded : float
        Share of the robot's mass that the last link may carry undeclared.
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
    gravity: tuple[float, ...] | None = None
    springs: bool = False
    loaded: float = _LOADED

    def is_worth(self, total: float, any_size: bool = False) -> bool:
        """Whether a reading leaves clearly less than springs and balancers of all joints would."""
        return is_clearly_less(total, self.sprung.miss(any_size), WORTH)

    def rivals_springs(self, total: float) -> bool:
        """Whether a reading does about as well as springs and balancers of all joints would."""
        return total < 2.0 * self.sprung.total + NONE

    @cached_property
    def sprung(self) -> Products:
        """What a fit with springs needs."""
        return self.share(replace(self, springs=True), "slack", "known").products

    @cached_property
    def carried(self) -> tuple[float, float]:
        """What a fit with another payload leaves, and its mass less the stated one's [kg].

        Infinite where what fits is no such body; NaN where the torques do not tell the mass.
        """
        other = self.share(replace(self, loaded=_PAYLOAD), "known")
        fit, heard = other.fitted, other.products.heard
        if not heard:
            return np.inf, np.nan
        body = self.bodies[0]
        ways = _list_ways(body, self.inertials, _PAYLOAD)
        last = ways[-N_PARAMETERS:]
        mass, *moment = (last @ fit.found[heard[0], : ways.shape[1]])[:4].tolist()
        reach = float(np.linalg.norm(np.diff(body.joint_origins(np.zeros(body.n))[0], axis=0), axis=1).sum())
        stated = max(one.payload.mass if one.payload else 0.0 for one in self.bodies)
        is_body = np.linalg.norm(moment) <= 2.0 * reach * abs(mass) and mass >= -_EMPTIED * stated
        told = other.products.tell(last[0]) > _TOLD
        return fit.total if is_body else np.inf, mass if told else np.nan

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

    def share(self, other: "Rows", *names: str) -> "Rows":
        """Other rows, with what has been computed of these and is the same."""
        other.__dict__.update({name: getattr(self, name) for name in names})
        return other

    def thin(self, most: int) -> "Rows":
        """Rows enough for a first look."""
        return self.pick(np.arange(0, len(self.q), max(1, len(self.q) // most)))

    def times(self, factor: np.ndarray, *names: str) -> "Rows":
        """Columns of the joints by a factor (n,)."""
        return replace(self, **{name: getattr(self, name) * factor for name in names})

    def miss(self, any_size: bool = False) -> float:
        """What all joints leave, with torques as they are, or each of any size and apart from the others."""
        if not any_size:
            return self.products.total
        return self._multiply(self._drive, self._drive.transpose(0, 2, 1) @ self._drive).any_size

    def _body(self, run: int) -> RigidBody:
        return self.bodies[run] if self.gravity is None else self.bodies[run].with_gravity(self.gravity)

    @cached_property
    def slack(self) -> np.ndarray:
        """What the links' parameters may add to the torques (N, n, P), each with the cost of one."""
        ways = _list_ways(self.bodies[0], self.inertials, self.loaded)
        return np.asarray(self._body(0).inertial_regressor(self.q, self.v, self.a) @ ways)

    @cached_property
    def known(self) -> np.ndarray:
        """Torque of the stated rigid body, payload and rotors (N, n)."""
        known = self.inertia * self.a
        for payload in {body.payload for body in self.bodies}:
            runs = [k for k, body in enumerate(self.bodies) if body.payload == payload]
            at = np.isin(self.run, runs)
            known[at] += self._body(runs[0]).inverse_dynamics(self.q[at], self.v[at], self.a[at])
        return known

    def with_torques(self, tau: np.ndarray) -> "Rows":
        """The same motion with other torques (N, n)."""
        return self.share(replace(self, tau=tau), "slack", "known", "columns", "own")

    @cached_property
    def _drive(self) -> np.ndarray:
        """Columns (n, N, D + 1) of each joint's drive and stated body, less their mean."""
        load, speed = self.sign * np.abs(self.known), np.abs(self.v) / np.maximum(self.top, 1e-300)
        falls = [np.exp(-speed / share) for share in FALLS]
        friction = [self.sign, self.v, *(self.sign * f for f in falls), load, *(load * f for f in falls)]
        return self._take_out(np.stack([self.a, *friction, self.known], axis=2))

    @cached_property
    def columns(self) -> np.ndarray:
        """Columns (n, N, P + D + 1) of links, drive and stated body, less their mean."""
        return np.concatenate([self._take_out(self.slack), self._drive], axis=2)

    def _take_out(self, columns: np.ndarray) -> np.ndarray:
        """Columns (N, n, K) as (n, N, K) less their mean and springs; 0 in rows that do not count."""
        counts, q = self.counts.T[:, :, None], self.q.T
        x = columns.transpose(1, 0, 2) * counts
        x -= counts * (x.sum(axis=1, keepdims=True) / np.maximum(counts.sum(axis=1, keepdims=True), 1))
        if self.springs:
            basis = np.stack([np.ones_like(q), q, np.sin(q), np.cos(q)], axis=2)
            basis = np.linalg.qr(counts * basis)[0]
            x -= basis @ (basis.transpose(0, 2, 1) @ x)
        return x

    @cached_property
    def own(self) -> np.ndarray:
        """Products (n, P + D + 1, P + D + 1) of the columns."""
        return np.asarray(self.columns.transpose(0, 2, 1) @ self.columns)

    @cached_property
    def products(self) -> Products:
        """What a fit needs of these rows."""
        return self._multiply(self.columns, self.own)

    def _multiply(self, x: np.ndarray, own: np.ndarray) -> Products:
        y, k = self._torques, x.shape[2]
        grams, scale = np.zeros((self.n, k + 1, k + 1)), self._scale
        grams[:, :k, :k], grams[:, k, k] = own, np.sum(y**2, axis=1)
        grams[:, :k, k] = grams[:, k, :k] = np.asarray(x.transpose(0, 2, 1) @ y[:, :, None])[:, :, 0]
        over = self.counts.sum(axis=0) * scale**2
        return Products(
            grams * np.where(scale > 0.0, 1.0 / np.maximum(over, 1e-300), 0.0)[:, None, None], scale
        )

    @cached_property
    def _torques(self) -> np.ndarray:
        """Torques (n, N), as the columns."""
        return self._take_out(self.tau[:, :, None])[:, :, 0]

    @cached_property
    def _scale(self) -> np.ndarray:
        """Spread (n,) of the torques in the rows that count; 0 where there are few or it is constant."""
        some = [self.tau[at, j] for j, at in enumerate(self.counts.T)]
        return np.array([y.std() if len(y) >= LEAST_ROWS and np.ptp(y) > 0.0 else 0.0 for y in some])

    @cached_property
    def fitted(self) -> Fit:
        """Fit of all joints."""
        return self.products.fit()

    def leave(self, blocks: np.ndarray) -> np.ndarray:
        """What the fit of all rows leaves in blocks of them, (B, n), in shares of each torque's variance.

        Parameters
        ----------
        blocks : ndarray (N,) of int
        """
        found, scale = self.fitted.found, np.where(self._scale > 0.0, self._scale, np.inf)
        errors = (
            self._torques - np.einsum("jnk,jk->jn", self.columns[:, :, :-1], found) - self.columns[:, :, -1]
        )
        shares = (errors / scale[:, None]) ** 2 / np.maximum(self.counts.sum(axis=0), 1)[:, None]
        return np.column_stack([np.bincount(blocks, own, blocks.max() + 1) for own in shares])


class Mixture:
    """Rows whose bodies' torques are weighed sums of other rows', as those at any gravity or shift are.

    Parameters
    ----------
    parts : list of Rows
        Alike except for their bodies' torques. Weights (K,) sum to one.
    """

    def __init__(self, parts: list[Rows]) -> None:
        self._parts = parts

    def miss(self, weights: np.ndarray, any_size: bool) -> float:
        """See `Rows.miss`."""
        first = self._parts[0]
        other = first.share(replace(first), "_torques", "_scale")
        other.__dict__["known"] = np.tensordot(weights, self._known, 1)
        if not any_size:
            other.__dict__["slack"] = np.tensordot(weights, self._slack, 1)
        return other.miss(any_size)

    @cached_property
    def _known(self) -> np.ndarray:
        return np.stack([rows.known for rows in self._parts])

    @cached_property
    def _slack(self) -> np.ndarray:
        return np.stack([rows.slack for rows in self._parts])


@lru_cache(maxsize=64)
def _list_ways(body: RigidBody, inertials: str, loaded: float) -> np.ndarray:
    """Ways (10 n, P) in which the links' parameters can act on torques, each with the cost of one.

    Some do not act on any torque, and others alike, whatever the motion and wherever gravity points.
    """
    q, v, a = np.random.default_rng(0).uniform(-3.0, 3.0, (3, 20, body.n))
    seen = [body.with_gravity(axis).inertial_regressor(q, v, a) for axis in np.diag([9.8] * 3).tolist()]
    deviations = _deviations(body, inertials, loaded)
    x = np.concatenate(seen) * deviations
    x /= np.maximum(np.linalg.norm(x, axis=(0, 2), keepdims=True), 1e-300)
    _, sizes, ways = np.linalg.svd(x.reshape(-1, x.shape[2]), full_matrices=False)
    return np.asarray(deviations[:, None] * ways[sizes > _ACTS * sizes[0]].T)


def _deviations(body: RigidBody, inertials: str, loaded: float) -> np.ndarray:
    """Deviation (10 n,) of each inertial parameter that has the cost of one."""
    links = body.inertial_parameters.reshape(-1, N_PARAMETERS)
    share, total = _SLACK[inertials], float(links[:, 0].sum())
    points = body.joint_origins(np.zeros(body.n))[0]
    arms = np.linalg.norm(np.diff(points[1:], axis=0), axis=1)
    radii = np.linalg.norm(links[:, 1:4], axis=1) / np.maximum(links[:, 0], 1e-300)
    length = max(float(np.median(np.maximum(arms, radii))), 1e-3)
    out = np.empty_like(links)
    for k, link in enumerate(links):
        carried = (loaded if k == len(links) - 1 else _CARRIED) * total
        out[k, 0] = share * link[0] + carried
        out[k, 1:4] = share * np.linalg.norm(link[1:4]) + carried * length
        out[k, 4:] = share * np.abs(link[4:]).max() + carried * length**2
    return out.ravel()
