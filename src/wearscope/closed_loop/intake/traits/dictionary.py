"""A coarse dictionary of machines: regressors (columns) of torques beyond the stated rigid body's.

The links' inertial parameters may differ from the stated ones, at a cost; each joint has a drive. What a
machine may have in addition (a payload, a spring, a balancer, a soft gear, friction that grows with the load,
falls with the speed or changes along the way) are terms. Each column is scaled so that its coefficient has a
prior standard deviation of 1, in units of the torque's spread.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from wearscope.closed_loop.intake.traits.reading import Reading
from wearscope.closed_loop.intake.traits.rows import Rows
from wearscope.robots.dynamics import N_PARAMETERS, RigidBody

#: Prior deviation of a link's parameters, as a share of the stated ones, trusted or approximate; mass that
#: every link may carry in addition, as a share of the robot's.
_SLACK, _CARRIED = {"trusted": 0.1, "approximate": 0.2}, 0.005
#: Usual mass of a payload as a share of the robot's, and its distance from the joint as a share of the reach.
_PAYLOAD, _AWAY = 1.0, 0.3
#: Largest torque of a rotor, over the largest torque that any joint's body needs.
_ROTOR = 10.0
#: Share of a joint's weight that a balancer carries.
_BALANCED = 0.3
#: Speeds over which friction falls, as shares of the largest speed.
_FALLS = (0.05, 0.3)
#: Number of waves of a force over the position; number of places of the range around which friction differs.
_WAVES, _PLACES = 6, 3
#: Columns that act at one joint alone. The first `DRIVE` are in every model; those of `FREE` may have either
#: sign.
OWN: tuple[str, ...] = ("inertia", "Coulomb", "sharp friction", "late friction", "viscous", "offset")
OWN = (*OWN, "load friction", "spring", "balancer", "balancer")
OWN = (*OWN, *["load friction"] * 2, *["falling friction"] * 2, *["falling load friction"] * 2)
OWN = (*OWN, *["force by position"] * (2 * _WAVES), *["friction by position"] * _PLACES)
OWN = (*OWN, *["damping by position"] * _PLACES)
DRIVE, FREE = 6, ("offset", "spring", "balancer", "force by position")
#: A change of the links' parameters counts as without effect below this share of the strongest one's effect.
_ACTS = 1e-9
#: Step [s] of the derivatives along a motion; step of a position, over its span.
_STEP, _BEND = 0.01, 1e-4


@dataclass(frozen=True)
class Columns:
    """Columns of a reading.

    Attributes
    ----------
    known : ndarray (N, n)
        Torque of the stated rigid body and payload.
    shared : ndarray (N, n, S)
        Columns of what acts on several joints: links, payload, one soft gear per tested joint.
    own : ndarray (N, n, D)
        Columns of `OWN`; where the dictionary is coarse, the first ones only.
    weight : ndarray (N, n)
        Torque of gravity.
    links : int
        Number of the links' columns.
    """

    known: np.ndarray
    shared: np.ndarray
    own: np.ndarray
    weight: np.ndarray
    links: int

    def pick(self, joints: np.ndarray) -> "Columns":
        """Columns of some joints."""
        return replace(
            self,
            **{name: getattr(self, name)[:, joints] for name in ("known", "shared", "own", "weight")},
        )


def make_columns(rows: Rows, reading: Reading, coarse: bool = False) -> Columns:
    """Columns of what the torques may hold, computed along the motion of a reading.

    Parameters
    ----------
    rows : Rows
    reading : Reading
    coarse : bool
        Without soft gears, friction that falls with the speed, and waves over the position.
    """
    moved, motors = rows.motion(reading), [] if coarse else rows.tested
    doubted = set(rows.run[rows.doubted].tolist())
    bodies = [
        _mount(run.signals.rigid_body, reading) if k in doubted else run.signals.rigid_body
        for k, run in enumerate(rows.prepared.runs)
    ]
    known, body = _known_torque(moved, bodies), bodies[int(rows.run[0])]
    links = np.empty((*known.shape, body.n * N_PARAMETERS))
    for one, at in _split(moved, bodies):
        links[at] = one.inertial_regressor(moved.q[at], moved.v[at], moved.a[at])
    inertials = rows.prepared.dataset.fields.robot.inertials
    slack = links @ _list_ways(rows.prepared.runs[0].signals.rigid_body, inertials)
    payload = links[:, :, -N_PARAMETERS:] * scale_payload(body)[0]
    payload = payload * moved.loaded[:, None, None]
    still = replace(moved, v=0.0 * moved.v, a=0.0 * moved.a)
    weight = _known_torque(still, bodies)
    if reading.without:
        # A controller subtracts the gravity of its own model; that of unknown bodies remains.
        bare = reading.without == "robot"
        taken = _known_torque(still, [one.with_payload(None) for one in bodies]) if bare else weight
        known = known - taken * rows.doubted[:, None]
    soft = _bend(moved, body, motors)
    top, slow = np.abs(moved.v).max(axis=0) + 1e-300, np.abs(moved.v)
    load = moved.sign * np.abs(known)
    own = [moved.a, moved.sign, moved.sharp, moved.late, moved.v, np.ones_like(known)]
    own += [load, moved.q, np.sin(moved.q), np.cos(moved.q)]
    if not coarse:
        own += [np.abs(known) * late for late in (moved.late, moved.slow)]
        falls = [np.exp(-slow / (share * top)) for share in _FALLS]
        own += [x * f for x in (moved.sign, load) for f in falls]
        low, high = moved.q.min(axis=0), moved.q.max(axis=0)
        turn = np.pi * (2.0 * moved.q - low - high) / np.maximum(high - low, 1e-300)
        own += [f(k * turn) for k in range(1, 1 + _WAVES) for f in (np.sin, np.cos)]
        along = [1.0 + np.cos(turn - 2.0 * np.pi * k / _PLACES) for k in range(_PLACES)]
        own += [x * one for x in (moved.sign, moved.v) for one in along]
    shared = np.concatenate([slack, payload, soft], axis=2)
    return Columns(known, shared, np.stack(own, axis=2), weight, slack.shape[2])


def _mount(body: RigidBody, reading: Reading) -> RigidBody:
    """A run's body under the gravity of a reading."""
    return body if reading.gravity is None else body.with_gravity(reading.gravity)


def _known_torque(moved: Rows, bodies: list[RigidBody]) -> np.ndarray:
    """Torque (N, n) of the stated bodies, each run with the payload that it declares."""
    known = np.zeros_like(moved.q)
    for body, at in _split(moved, bodies):
        known[at] = body.inverse_dynamics(moved.q[at], moved.v[at], moved.a[at])
    return known


def _split(moved: Rows, bodies: list[RigidBody]) -> list[tuple[RigidBody, np.ndarray]]:
    """Each distinct body, by payload and gravity, with a mask (N,) of the rows of its runs."""
    kinds = {k: (bodies[k].payload, bodies[k].gravity) for k in np.unique(moved.run).tolist()}
    alike = {kind: [k for k, one in kinds.items() if one == kind] for kind in kinds.values()}
    return [(bodies[runs[0]], np.isin(moved.run, runs)) for runs in alike.values()]


def _bend(moved: Rows, body: RigidBody, motors: list[int]) -> np.ndarray:
    """Derivative (N, n, M) of all torques with respect to the compliance of each motor's gear."""
    q, v, a, step = moved.q, moved.v, moved.a, _STEP
    if not motors:
        return np.zeros((*q.shape, 0))
    now = body.inverse_dynamics(q, v, a)

    def look(s: float) -> np.ndarray:
        """Torque `s` seconds later."""
        half, jerk = s**2 / 2, moved.jerk
        return body.inverse_dynamics(
            q + s * v + half * a, v + s * a + half * jerk, a + s * jerk + half * moved.snap
        )

    later, before = look(step), look(-step)
    rate, bend = (later - before) / (2 * step), (later - 2 * now + before) / step**2
    out = np.zeros((*q.shape, len(motors)))
    for k, j in enumerate(motors):
        one = np.eye(moved.n)[j]
        size = _BEND * max(float(np.ptp(q[:, j])), 1e-6) / max(float(np.abs(now[:, j]).max()), 1e-12)
        moves = [x - size * np.outer(y[:, j], one) for x, y in ((q, now), (v, rate), (a, bend))]
        out[:, :, k] = (body.inverse_dynamics(*moves) - now) / size
    return out


def scale_payload(body: RigidBody) -> tuple[np.ndarray, float]:
    """Standard deviation (10,) of a payload's inertial parameters, and the robot's reach [m]."""
    arms = np.linalg.norm(np.diff(body.joint_origins(np.zeros(body.n))[0], axis=0), axis=1)
    mass, reach = float(body.inertial_parameters[::N_PARAMETERS].sum()), float(arms.sum())
    away = _AWAY * reach
    return _PAYLOAD * mass * np.repeat([1.0, away, away**2], [1, 3, 6]), reach


def scale_columns(columns: Columns, scale: np.ndarray, most: float) -> np.ndarray:
    """Each joint's own columns (N, n, D) over its torque's spread.

    Parameters
    ----------
    columns : Columns
    scale : ndarray (n,)
        The torques' spread.
    most : float
        Largest torque that any joint's body needs.
    """
    names = np.array(OWN)[: columns.own.shape[2]]
    size = np.ones((len(scale), len(names)))
    size[:, names == "inertia"] = (_ROTOR * most / scale)[:, None]
    size[:, names == "balancer"] = (_BALANCED * _rms(columns.weight) / scale)[:, None]
    return np.asarray(columns.own * (size / (_rms(columns.own) + 1e-300)))


def _rms(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(x**2, axis=0)))


@lru_cache(maxsize=64)
def _list_ways(body: RigidBody, inertials: str) -> np.ndarray:
    """Directions (10 n, P) of the links' parameters that torques can show, one prior deviation long each.

    Some parameters act on no torque, and some act alike, whatever the motion and the direction of gravity.
    """
    q, v, a = np.random.default_rng(0).uniform(-3.0, 3.0, (3, 20, body.n))
    seen = [body.with_gravity(axis).inertial_regressor(q, v, a) for axis in np.diag([9.8] * 3).tolist()]
    deviations = _list_deviations(body, inertials)
    x = np.concatenate(seen) * deviations
    x /= np.maximum(np.linalg.norm(x, axis=(0, 2), keepdims=True), 1e-300)
    _, sizes, ways = np.linalg.svd(x.reshape(-1, x.shape[2]), full_matrices=False)
    return np.asarray(deviations[:, None] * ways[sizes > _ACTS * sizes[0]].T)


def _list_deviations(body: RigidBody, inertials: str) -> np.ndarray:
    """Standard deviation (10 n,) of each inertial parameter about the stated one."""
    links = body.inertial_parameters.reshape(-1, N_PARAMETERS)
    share, total = _SLACK[inertials], float(links[:, 0].sum())
    arms = np.linalg.norm(np.diff(body.joint_origins(np.zeros(body.n))[0][1:], axis=0), axis=1)
    radii = np.linalg.norm(links[:, 1:4], axis=1) / np.maximum(links[:, 0], 1e-300)
    length = max(float(np.median(np.maximum(arms, radii))), 1e-3)
    out = np.empty_like(links)
    carried = _CARRIED * total
    for k, link in enumerate(links):
        xx, _, yy, _, _, zz = np.sqrt(np.maximum(link[4:], 0.0))
        out[k, 0] = share * link[0] + carried
        out[k, 1:4] = share * np.linalg.norm(link[1:4]) + carried * length
        out[k, 4:] = share * np.array([xx * xx, xx * yy, yy * yy, xx * zz, yy * zz, zz * zz])
        out[k, 4:] += carried * length**2
    return out.ravel()
