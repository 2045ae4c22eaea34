"""The board's own regressors, in the usual form of each effect, for separability.

They are deliberately plain and know nothing of `wearscope.effects`: a family is a list of variants (a grid
over the nonlinear parameters), and a variant is a set of columns along the runs.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from benchmarks.board.machines import Body
from benchmarks.board.terms import slip_spring

Array = NDArray[np.float64]

CUTOFF_HZ = 20.0
KEPT_RATE_HZ = 50.0
REST = 0.005
"""Speed below which a joint is taken to rest, as a share of the top speed."""
GRAIN = 0.002
"""Speed over which friction changes sign, as a share of the top speed."""


@dataclass(frozen=True)
class Track:
    """One run at its sample rate: (N,) `t`, (N, n) `q`, `v`, `a`, `rigid` torque, or None `temperature`.

    `load` (N, n) is the torque that passes the gear, as well as it is known.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    rigid: Array
    temperature: Array | None
    payload_columns: Array | None
    body: Body
    load: Array

    def shifted(self, j: int, ahead: Array) -> Array:
        """Change of joint j's rigid-body torque by a small lead `ahead` (N,) of its measured position."""
        scale = 1e-3 * float(np.ptp(self.q[:, j])) / (float(np.abs(ahead).max()) + 1e-12)
        moved = [self.q.copy(), self.v.copy(), self.a.copy()]
        column = scale * ahead
        for signal in moved:
            signal[:, j] += column
            column = _derivative(column, self.t)
        return (self.rigid[:, j] - self.body.torque(*moved)[:, j]) / scale


def make_track(
    body: Body, urdf: str, t: Array, q: Array, v: Array, a: Array, temperature: Array | None,
    payload: bool, load: Array | None = None,
) -> Track:  # fmt: skip
    """Track with its rigid-body quantities; `payload` asks for the payload's columns (N, n, 4).

    `load` (N, n) is the torque through the gear where it is known; else the rigid torque below 10 Hz.
    """
    rigid = body.torque(q, v, a)
    columns = None
    if payload:
        bare = Body(urdf, tuple(body.model.gravity.linear), 0.0, (0.0, 0.0, 0.0)).torque(q, v, a)
        # a point mass's torque is m A + m (c.B) + m c'Cc; small moves of c about 0 give A and B
        unit, small = [], 1e-3
        origin = Body(urdf, tuple(body.model.gravity.linear), 1.0, (0.0, 0.0, 0.0)).torque(q, v, a) - bare
        unit.append(origin)
        for axis in np.eye(3):
            ahead = Body(urdf, tuple(body.model.gravity.linear), 1.0, tuple(small * axis))
            unit.append((ahead.torque(q, v, a) - bare - origin) / small)
        columns = np.stack(unit, axis=-1)
    if load is None:
        load = calm(rigid, 1.0 / (t[1] - t[0]))
    return Track(t, q, v, a, rigid, temperature, columns, body, load)


def smooth(columns: Array, rate: float) -> Array:
    """Zero-phase low-pass at 20 Hz and thinning to about 50 Hz, alike for torque and regressors (N, k)."""
    sos = butter(3, min(CUTOFF_HZ, 0.4 * rate), fs=rate, output="sos")
    thin = max(1, round(rate / KEPT_RATE_HZ))
    return sosfiltfilt(sos, columns, axis=0)[thin:-thin:thin]


def calm(x: Array, rate: float) -> Array:
    """A load (N, ...) without what differentiating it twice would blow up: zero-phase low-pass at 10 Hz."""
    return sosfiltfilt(butter(3, 10.0, fs=rate, output="sos"), x, axis=0)


def _derivative(x: Array, t: Array) -> Array:
    return np.gradient(x, t, edge_order=2)


class _Joint:
    """Signals (N,) of one joint along a track, and its scales."""

    def __init__(self, track: Track, families: "Families"):
        self.track, self.j, self.t, self.families = track, families.joint, track.t, families
        self.q, self.v, self.a, self.rigid, self.load = (
            x[:, self.j] for x in (track.q, track.v, track.a, track.rigid, track.load)
        )
        self.sign, self.size, self.top = np.tanh(self.v / families.grain), np.abs(self.v), families.top_speed
        self.reach, self.slides = families.reach, families.prismatic
        self.angle = (self.q - families.middle) / (self.reach if self.slides else 1.0)
        self.warm = None if track.temperature is None else track.temperature[:, self.j] - 35.0

    def shift(self, ahead: Array) -> Array:
        """See `Track.shifted`."""
        return self.track.shifted(self.j, ahead)

    def fade(self, share: float) -> Array:
        """Falls from 1 within a share of the run."""
        return np.exp(-(self.t - self.t[0]) / (share * (self.t[-1] - self.t[0])))

    def fall(self, share: float, power: float = 1.0) -> Array:
        """Friction that falls within a share of the top speed."""
        return np.exp(-((self.size / (share * self.top)) ** power)) * self.sign


def _law(s: _Joint) -> list[list[Array]]:
    bumps = [s.fall(0.03), s.fall(0.1)]
    warm = [] if s.warm is None else [s.warm * s.v, *(s.warm * bump for bump in bumps)]
    return [[s.sign, s.v, *bumps, *warm]]


def _backlash(s: _Joint) -> list[list[Array]]:
    level = float(np.sqrt(np.mean(s.rigid**2))) + 1e-9
    return [[s.shift(np.tanh(s.load / (share * level)))] for share in (0.05, 0.1, 0.2)]


def _ripple(s: _Joint) -> list[list[Array]]:
    orders = [2 * np.pi / (s.reach * share) for share in (0.02, 0.05, 0.1)] if s.slides else []
    return [[np.sin(k * s.q), np.cos(k * s.q)] for k in (*orders, *s.families.ripple_orders)]


def _counterbalance(s: _Joint) -> list[list[Array]]:
    if s.slides:
        return [[s.angle, s.angle**2, s.angle**3]]
    once, twice = ([np.sin(k * s.angle), np.cos(k * s.angle)] for k in (1, 2))
    return [once, [*once, *twice]]


def _coupling(s: _Joint) -> list[list[Array]]:
    speeds = [s.track.v[:, k] for k in range(s.track.q.shape[1]) if k != s.j]
    return [[np.tanh(v / (GRAIN * np.abs(v).max() + 1e-12)), v] for v in speeds]


CANDIDATES: dict[str, Callable[[_Joint], list[list[Array]]]] = {
    "coulomb": lambda s: [[s.sign]],
    "viscous": lambda s: [[s.v]],
    "rotor_inertia": lambda s: [[s.a]],
    "torque_offset": lambda s: [[np.ones_like(s.t)]],
    "stribeck": lambda s: [[s.fall(share, p)] for share in (0.02, 0.04, 0.08, 0.15) for p in (1.0, 2.0)],
    "coulomb_asymmetry": lambda s: [[s.sign**2]],
    "viscous_asymmetry": lambda s: [[s.size]],
    "quadratic_viscous": lambda s: [[s.v * s.size]],
    "concave_viscous": lambda s: [[(s.size / s.top) ** p * s.sign] for p in (0.35, 0.5, 0.7)],
    "load_dependent_friction": lambda s: [[np.abs(s.rigid) * s.sign]],
    "temperature_dependent_friction": lambda s: [[s.warm * s.sign, s.warm * s.v]],
    "warm_up_drift": lambda s: [[s.fade(x) * s.sign, s.fade(x) * s.v] for x in (0.1, 0.2, 0.4, 1.0)],
    "presliding_hysteresis": lambda s: [[slip_spring(s.q, x * s.reach)] for x in (0.004, 0.01, 0.02, 0.04)],
    "backlash": _backlash,
    "joint_elasticity": lambda s: [[s.shift(s.load)]],
    "torque_ripple": _ripple,
    "joint_spring": lambda s: [[s.q, np.ones_like(s.q)]],
    "gravity_counterbalance": _counterbalance,
    "torque_constant_error": lambda s: [[s.rigid]],
    "time_delay": lambda s: [
        [_derivative(s.rigid, s.t), _derivative(s.sign, s.t)], [_derivative(s.rigid, s.t)],
    ],
    "cross_coupling": _coupling,
    "payload_error": lambda s: [[*s.track.payload_columns[:, s.j].T]],
}  # fmt: skip
"""Columns of the variants of each family that a verdict may name."""
COLUMNS = CANDIDATES | {
    "rotor_inertia_error": CANDIDATES["rotor_inertia"], "friction_wear_temperature": _law,
}  # fmt: skip
FIXED = ("rigid_body", "rotor_inertia_given")
"""Declared effects without a parameter of their own to refit."""


class Families:
    """Columns of every candidate family for one joint over some tracks.

    Parameters
    ----------
    tracks : list of Track
    joint : int
    rate : float
        Sample rate of the tracks [Hz].
    prismatic : bool
    declared : sequence of str
        Names of the declared effects that are refitted.
    ripple_orders : sequence of float
        Orders of ripple to try [cycles by 2 pi joint units].
    """

    def __init__(
        self,
        tracks: list[Track],
        joint: int,
        rate: float,
        prismatic: bool,
        declared: list[str],
        ripple_orders: tuple[float, ...] = (8, 12, 16, 20, 24, 28, 32, 36, 40, 60, 80, 120),
    ):
        self.tracks, self.joint, self.rate, self.prismatic = tracks, joint, rate, prismatic
        speed = np.concatenate([np.abs(track.v[:, joint]) for track in tracks])
        self.top_speed = float(speed.max())
        self.grain = GRAIN * self.top_speed
        centre = np.concatenate([track.q[:, joint] for track in tracks])
        self.middle, self.reach = float(np.median(centre)), float(np.ptp(centre)) / 2
        self.declared_names = declared
        self.ripple_orders = ripple_orders
        columns = [x for name in declared if name not in FIXED for x in self.variants(name)]
        self.declared = np.hstack(columns or [np.zeros((sum(self.lengths()), 0))])

    def lengths(self) -> list[int]:
        """Number of kept rows of each track."""
        thin = max(1, round(self.rate / KEPT_RATE_HZ))
        return [len(range(thin, len(track.t) - thin, thin)) for track in self.tracks]

    def moving(self) -> NDArray[np.bool_]:
        """Rows (N,) where the joint moves; at rest friction is undetermined and hides what else there is."""
        thin = max(1, round(self.rate / KEPT_RATE_HZ))
        speed = np.concatenate([np.abs(track.v[thin:-thin:thin, self.joint]) for track in self.tracks])
        return speed > REST * self.top_speed

    def names(self) -> list[str]:
        """Candidate names that make sense on these tracks and are not declared."""
        track, absent = self.tracks[0], {*self.declared_names}
        if track.temperature is None:
            absent.add("temperature_dependent_friction")
        if track.q.shape[1] == 1:
            absent.add("cross_coupling")
        if track.payload_columns is None:
            absent.add("payload_error")
        if "friction_wear_temperature" in absent:
            absent |= {"coulomb", "viscous"}
        return [name for name in CANDIDATES if name not in absent]

    def variants(self, name: str) -> list[Array]:
        """Columns (N, k) of every variant of a family, smoothed and pooled over the tracks."""
        by_track = [COLUMNS[name](_Joint(track, self)) for track in self.tracks]
        return [
            np.vstack([smooth(np.column_stack(columns), self.rate) for columns in variant])
            for variant in zip(*by_track, strict=True)
        ]

    def pool(self, signals: list[Array]) -> Array:
        """Smooth and pool one signal (N,) by track in the same way."""
        return np.concatenate([smooth(x[:, None], self.rate)[:, 0] for x in signals])
