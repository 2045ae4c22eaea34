"""The board's own regressors, in the usual form of each effect, for separability and for the baselines.

They are deliberately plain and know nothing of `wearscope.effects`: a family is a list of variants (a grid
over the nonlinear parameters), and a variant is a set of columns along the runs.
"""

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
    like : Families, optional
        Takes its speed and position scales, so that columns of test runs mean what they mean in training.
    """

    def __init__(
        self,
        tracks: list[Track],
        joint: int,
        rate: float,
        prismatic: bool,
        declared: list[str],
        ripple_orders: tuple[float, ...] = (8, 12, 16, 20, 24, 28, 32, 36, 40, 60, 80, 120),
        like: "Families | None" = None,
    ):
        self.tracks, self.joint, self.rate, self.prismatic = tracks, joint, rate, prismatic
        speed = np.concatenate([np.abs(track.v[:, joint]) for track in tracks])
        self.top_speed = float(speed.max())
        self.grain = GRAIN * self.top_speed
        centre = np.concatenate([track.q[:, joint] for track in tracks])
        self.middle, self.reach = float(np.median(centre)), float(np.ptp(centre)) / 2
        if like is not None:
            self.top_speed, self.grain = like.top_speed, like.grain
            self.middle, self.reach = like.middle, like.reach
        self.declared_names = declared
        self.ripple_orders = ripple_orders
        columns = [x for name in declared if name not in FIXED for x in self._pooled(name)]
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
        names = [
            "coulomb", "viscous", "rotor_inertia", "torque_offset", "stribeck", "coulomb_asymmetry",
            "viscous_asymmetry", "quadratic_viscous", "concave_viscous", "load_dependent_friction",
            "warm_up_drift", "presliding_hysteresis", "backlash", "joint_elasticity", "torque_ripple",
            "joint_spring", "gravity_counterbalance", "torque_constant_error", "time_delay",
        ]  # fmt: skip
        if self.tracks[0].temperature is not None:
            names.append("temperature_dependent_friction")
        if self.tracks[0].q.shape[1] > 1:
            names.append("cross_coupling")
        if self.tracks[0].payload_columns is not None:
            names.append("payload_error")
        covered = {"coulomb", "viscous"} if "friction_wear_temperature" in self.declared_names else set()
        return [name for name in names if name not in covered and name not in self.declared_names]

    def variants(self, name: str) -> list[Array]:
        """Columns (N, k) of every variant of a family, smoothed and pooled over the tracks."""
        return self._pooled(name)

    def _pooled(self, name: str) -> list[Array]:
        by_track = [self._columns(name, track) for track in self.tracks]
        return [
            np.vstack([smooth(np.column_stack(columns), self.rate) for columns in variant])
            for variant in zip(*by_track, strict=True)
        ]

    def pool(self, signals: list[Array]) -> Array:
        """Smooth and pool one signal (N,) by track in the same way."""
        return np.concatenate([smooth(x[:, None], self.rate)[:, 0] for x in signals])

    def _columns(self, name: str, track: Track) -> list[list[Array]]:
        j, t = self.joint, track.t
        q, v, a, rigid = track.q[:, j], track.v[:, j], track.a[:, j], track.rigid[:, j]
        sign = np.tanh(v / self.grain)
        size, top = np.abs(v), self.top_speed
        level = float(np.sqrt(np.mean(rigid**2))) + 1e-9
        angle = q - self.middle if not self.prismatic else (q - self.middle) / self.reach
        if name == "coulomb":
            return [[sign]]
        if name == "viscous":
            return [[v]]
        if name in ("rotor_inertia", "rotor_inertia_error"):
            return [[a]]
        if name == "friction_wear_temperature":
            bumps = [np.exp(-size / (share * top)) * sign for share in (0.03, 0.1)]
            columns = [sign, v, *bumps]
            if track.temperature is not None:
                warm = track.temperature[:, j] - 35.0
                columns += [warm * v, *(warm * bump for bump in bumps)]
            return [columns]
        if name == "torque_offset":
            return [[np.ones_like(t)]]
        if name == "stribeck":
            speeds = (0.02, 0.04, 0.08, 0.15)
            return [[np.exp(-((size / (s * top)) ** p)) * sign] for s in speeds for p in (1.0, 2.0)]
        if name == "coulomb_asymmetry":
            return [[sign**2]]
        if name == "viscous_asymmetry":
            return [[size]]
        if name == "quadratic_viscous":
            return [[v * size]]
        if name == "concave_viscous":
            return [[(size / top) ** p * sign] for p in (0.35, 0.5, 0.7)]
        if name == "load_dependent_friction":
            return [[np.abs(rigid) * sign]]
        if name == "temperature_dependent_friction":
            assert track.temperature is not None
            warm = track.temperature[:, j] - 35.0
            return [[warm * sign, warm * v]]
        if name == "warm_up_drift":
            span = t[-1] - t[0]
            fades = [np.exp(-(t - t[0]) / (s * span)) for s in (0.1, 0.2, 0.4, 1.0)]
            return [[fade * sign, fade * v] for fade in fades]
        if name == "presliding_hysteresis":
            return [[slip_spring(q, s * self.reach)] for s in (0.004, 0.01, 0.02, 0.04)]
        if name == "backlash":
            return [[track.shifted(j, np.tanh(track.load[:, j] / (s * level)))] for s in (0.05, 0.1, 0.2)]
        if name == "joint_elasticity":
            return [[track.shifted(j, track.load[:, j])]]
        if name == "torque_ripple":
            orders = [2 * np.pi / (self.reach * s) for s in (0.02, 0.05, 0.1)] if self.prismatic else []
            return [[np.sin(k * q), np.cos(k * q)] for k in (*orders, *self.ripple_orders)]
        if name == "joint_spring":
            return [[q, np.ones_like(q)]]
        if name == "gravity_counterbalance":
            if self.prismatic:
                return [[angle, angle**2, angle**3]]
            return [
                [np.sin(angle), np.cos(angle)],
                [np.sin(angle), np.cos(angle), np.sin(2 * angle), np.cos(2 * angle)],
            ]
        if name == "torque_constant_error":
            return [[rigid]]
        if name == "time_delay":
            return [[_derivative(rigid, t), _derivative(sign, t)], [_derivative(rigid, t)]]
        if name == "cross_coupling":
            others = [k for k in range(track.q.shape[1]) if k != j]
            return [
                [np.tanh(track.v[:, k] / (GRAIN * np.abs(track.v[:, k]).max() + 1e-12)), track.v[:, k]]
                for k in others
            ]
        assert name == "payload_error" and track.payload_columns is not None
        return [[track.payload_columns[:, j, i] for i in range(4)]]


def left_over(target: Array, columns: Array) -> float:
    """Share of a signal's mean square (N,) that least squares on `columns` (N, k) leaves."""
    if columns.shape[1] == 0:
        return 1.0
    scale = np.sqrt(np.mean(columns**2, axis=0))
    columns = columns[:, scale > 0] / scale[scale > 0]
    solution, *_ = np.linalg.lstsq(columns, target, rcond=1e-9)
    return float(np.mean((target - columns @ solution) ** 2) / np.mean(target**2))
