"""Defines a robot for the demonstration and motions whose position, speed and acceleration are exact.

All three are closed-form functions of time; the position is four times differentiable. The module shares no
code with `wearscope.robots`.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Machine:
    """A robot of the demonstration; each tuple over joints is ordered from base to tip.

    Attributes
    ----------
    name : str
    urdf : str
        Text of the URDF, which is written into the data set's folder.
    joints : tuple of str
    prismatic : tuple of bool
        True for a prismatic joint, whose position is in m and whose torque is a force in N.
    rotor_inertia : tuple of float
        Rotor inertia reflected to the joint [kg m^2, or kg].
    gear_ratio : tuple of float
        Motor angle per joint position [rad/rad, or rad/m].
    coulomb, viscous : tuple of float
        Friction at the joint [N m and N m s/rad, or N and N s/m].
    centre, reach : tuple of float
        Middle of the working range and half its width [rad, or m].
    speed, acceleration : tuple of float
        Limits for the motions [rad/s and rad/s^2, or m/s and m/s^2].
    payload_mass : float
        Declared payload [kg]; 0 without payload.
    payload_com : tuple of float
        Centre of mass of the payload in the last link's frame [m].
    gravity : tuple of float
        Gravity in the base frame [m/s^2].
    """

    name: str
    urdf: str
    joints: tuple[str, ...]
    prismatic: tuple[bool, ...]
    rotor_inertia: tuple[float, ...]
    gear_ratio: tuple[float, ...]
    coulomb: tuple[float, ...]
    viscous: tuple[float, ...]
    centre: tuple[float, ...]
    reach: tuple[float, ...]
    speed: tuple[float, ...]
    acceleration: tuple[float, ...]
    payload_mass: float = 0.0
    payload_com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gravity: tuple[float, float, float] = field(default=(0.0, 0.0, -9.81))

    def torque_unit(self, joint: int) -> str:
        """Return the unit of a joint's torque."""
        return "N" if self.prismatic[joint] else "N m"

    def position_unit(self, joint: int) -> str:
        """Return the unit of a joint's position."""
        return "m" if self.prismatic[joint] else "rad"


Array = NDArray[np.float64]

#: Shortest time of acceleration [s]; drives limit the jerk in the same way.
SHORTEST_RAMP = 0.25


@dataclass(frozen=True)
class Motion:
    """A motion on a uniform time grid: `t` (N,); position `q`, speed `v`, acceleration `a` (N, n)."""

    t: Array
    q: Array
    v: Array
    a: Array


def _step(x: Array) -> tuple[Array, Array, Array, Array]:
    """Return integral, value, first and second derivative of a degree-7 smooth step from 0 at 0 to 1 at 1."""
    inside = np.clip(x, 0.0, 1.0)
    integral = inside**5 * (7 - 14 * inside + 10 * inside**2 - 2.5 * inside**3) + np.maximum(x - 1.0, 0.0)
    value = inside**4 * (35 - 84 * inside + 70 * inside**2 - 20 * inside**3)
    slope = 140 * inside**3 * (1 - inside) ** 3
    bend = 420 * inside**2 * (1 - inside) ** 2 * (1 - 2 * inside)
    return integral, value, slope, bend


def add_move(
    q: Array, v: Array, a: Array, t: Array, start: float, time: float, ramp: float, by: float
) -> None:
    """Add to `q`, `v`, `a` (in place) a move by `by` that begins at `start` and takes `time` [s].

    The share `ramp` of the time is acceleration, as much is deceleration; the speed is constant in between.
    """
    ramp_time = ramp * time
    peak = by / (time - ramp_time)
    first, last = np.searchsorted(t, (start, start + time))
    now = slice(int(first), int(last))
    for begin, sign in ((start, 1.0), (start + time - ramp_time, -1.0)):
        integral, value, slope, _ = _step((t[now] - begin) / ramp_time)
        q[now] += sign * peak * ramp_time * integral
        v[now] += sign * peak * value
        a[now] += sign * peak / ramp_time * slope
    q[int(last) :] += by


def move_time(by: float, speed: float, acceleration: float, ramp: float) -> float:
    """Return the shortest time [s] of `add_move` within limits of speed, acceleration and `SHORTEST_RAMP`."""
    by = abs(by)
    steep = 140 / 64  # largest slope of the smooth step
    return max(
        by / (speed * (1 - ramp)),
        float(np.sqrt(by * steep / (acceleration * ramp * (1 - ramp)))),
        SHORTEST_RAMP / ramp,
    )


def excite_fourier(machine: Machine, rng: np.random.Generator, t: Array) -> Motion:
    """Excite all joints by sums of ten sines each, which begin and end at rest and use the full limits."""
    n, span = len(machine.joints), t[-1]
    fade = 1.5
    _, up, up1, up2 = _step((t - 0.4) / fade)
    _, down, down1, down2 = _step((t - (span - 0.4 - fade)) / fade)
    s, s1, s2 = up - down, (up1 - down1) / fade, (up2 - down2) / fade**2
    q, v, a = (np.zeros((len(t), n)) for _ in range(3))
    base = 2 * np.pi / span
    for j in range(n):
        harmonics = np.arange(1, 11) * max(1, round(span / 12))
        omega = base * harmonics
        amplitude = rng.normal(size=10) / harmonics**1.1
        phase = rng.uniform(0, 2 * np.pi, 10)
        angle = np.outer(t, omega) + phase
        f, f1, f2 = (
            np.sin(angle) @ amplitude,
            np.cos(angle) @ (amplitude * omega),
            -np.sin(angle) @ (amplitude * omega**2),
        )
        raw = s * f, s1 * f + s * f1, s2 * f + 2 * s1 * f1 + s * f2
        limits = machine.reach[j], machine.speed[j], machine.acceleration[j]
        scale = min(limit / np.abs(column).max() for limit, column in zip(limits, raw, strict=True))
        q[:, j], v[:, j], a[:, j] = (scale * column for column in raw)
    return Motion(t, q + np.asarray(machine.centre), v, a)


def sweep_joints(machine: Machine, rng: np.random.Generator, t: Array) -> Motion:
    """Move each joint by itself to random positions, at constant speeds from slow to fast, with dwells."""
    n = len(machine.joints)
    q, v, a = (np.zeros((len(t), n)) for _ in range(3))
    shares = (0.03, 0.08, 0.2, 0.45, 1.0)
    for j in range(n):
        clock, at, turn = 0.3 + rng.uniform(0, 0.4), 0.0, 0
        order = rng.permutation(len(shares))
        while True:
            share = shares[order[turn % len(shares)]] * rng.uniform(0.85, 1.15)
            turn += 1
            target = float(rng.uniform(-1, 1)) * machine.reach[j]
            longest = share * machine.speed[j] * 1.6
            by = float(np.clip(target - at, -longest, longest))
            time = move_time(by, share * machine.speed[j], machine.acceleration[j], 0.3)
            if clock + time > t[-1] - 0.3:
                break
            add_move(q[:, j], v[:, j], a[:, j], t, clock, time, 0.3, by)
            at += by
            clock += time + (rng.uniform(0.15, 0.5) if rng.uniform() < 0.5 else 0.0)
    return Motion(t, q + np.asarray(machine.centre), v, a)


def move_between_points(machine: Machine, rng: np.random.Generator, t: Array) -> Motion:
    """Move all joints together through random poses; some moves are slow, some are followed by a dwell."""
    n = len(machine.joints)
    q, v, a = (np.zeros((len(t), n)) for _ in range(3))
    reach = np.asarray(machine.reach)
    clock, at = 0.4, np.zeros(n)
    while True:
        target = rng.uniform(-0.95, 0.95, n) * reach
        share = float(rng.choice([0.25, 0.6, 1.0, 1.0]))
        by = (target - at) * (0.4 if share < 0.3 else 1.0)
        times = [
            move_time(b, share * s, c, 0.4)
            for b, s, c in zip(by, machine.speed, machine.acceleration, strict=True)
        ]
        time = max(times)
        if clock + time > t[-1] - 0.4:
            break
        for j in range(n):
            add_move(q[:, j], v[:, j], a[:, j], t, clock, time, 0.4, float(by[j]))
        at = at + by
        clock += time + (rng.uniform(0.3, 0.8) if rng.uniform() < 0.4 else 0.02)
    return Motion(t, q + np.asarray(machine.centre), v, a)


KINDS = {"fourier": excite_fourier, "sweep": sweep_joints, "points": move_between_points}


def make_motion(machine: Machine, kind: str, seed: int, duration: float, rate: float) -> Motion:
    """Make a random motion of a given kind.

    Parameters
    ----------
    machine : Machine
    kind : str
        One of `KINDS`.
    seed : int
        Seed of the motion; equal seeds give equal motions, so two runs can repeat one.
    duration, rate : float
        Duration [s] and rate of the time grid [Hz].
    """
    t = np.arange(round(duration * rate)) / rate
    return KINDS[kind](machine, np.random.default_rng(np.random.SeedSequence(seed)), t)
