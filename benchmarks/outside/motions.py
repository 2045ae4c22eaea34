"""Motions as people record them: position, speed and acceleration that belong together exactly."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly


@dataclass(frozen=True)
class Motion:
    """A motion.

    Attributes
    ----------
    t : ndarray (M,)
        [s]
    q, v, a : ndarray (M, n)
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


def _middle(arm, room=0.42):
    """Centre and half range that a motion may use (n,)."""
    low, high = arm.column("lower"), arm.column("upper")
    width = np.minimum(high - low, np.where([j.prismatic for j in arm.joints], np.inf, 3.6))
    return (low + high) / 2, room * width


def make_fourier(arm, rng, seconds, rate, fast=0.8, harmonics=6):
    """A Fourier series a joint, as large as range, `fast` times the speed and the acceleration allow."""
    t = np.arange(round(seconds * rate)) / rate
    middle, half = _middle(arm)
    n = len(arm.joints)
    base = 2 * np.pi / rng.uniform(9.0, 14.0)
    w = base * np.arange(1, harmonics + 1)
    q, v, a = np.zeros((3, len(t), n))
    for j in range(n):
        size = rng.normal(size=harmonics) / np.arange(1, harmonics + 1) ** 0.7
        phase = rng.uniform(0, 2 * np.pi, harmonics)
        arg = np.outer(t, w) + phase
        q[:, j], v[:, j], a[:, j] = np.sin(arg) @ size, np.cos(arg) @ (size * w), -np.sin(arg) @ (size * w**2)
    scale = np.minimum(half / np.abs(q).max(0), fast * arm.column("speed") / np.abs(v).max(0))
    scale = np.minimum(scale, fast * arm.column("acceleration") / np.abs(a).max(0))
    return Motion(t, q * scale + middle, v * scale, a * scale)


def make_quintic():
    """Unit move with no speed and acceleration at its ends, over unit time: PPoly of its acceleration."""
    return PPoly(np.array([[120.0], [-180.0], [60.0], [0.0]]), np.array([0.0, 1.0]))


def make_trapezoid(blend=0.25, jerk=0.3):
    """Unit move over unit time whose speed is a trapezoid with corners rounded by limited jerk."""
    r = blend * jerk
    knots = np.array([0, r, blend - r, blend, 1 - blend, 1 - blend + r, 1 - r, 1.0])
    height = np.array([0, 1, 1, 0, 0, -1, -1, 0.0])
    slope = np.diff(height) / np.diff(knots)
    shape = PPoly(np.vstack([slope, height[:-1]]), knots)
    return PPoly(shape.c / float(shape.antiderivative(2)(1.0)), knots)


def _play(t, moves, start):
    """Motion of one after another move (begin, duration, from, to, shape)."""
    n = len(start)
    q, v, a = np.tile(start, (len(t), 1)), np.zeros((len(t), n)), np.zeros((len(t), n))
    for begin, duration, origin, target, shape in moves:
        inside = (t >= begin) & (t < begin + duration)
        s = (t[inside] - begin) / duration
        step = np.asarray(target) - origin
        q[t >= begin + duration] = target
        q[inside] = origin + np.outer(shape.antiderivative(2)(s), step)
        v[inside] = np.outer(shape.antiderivative(1)(s), step) / duration
        a[inside] = np.outer(shape(s), step) / duration**2
    return Motion(t, q, v, a)


def _duration(shape, step, speed, acceleration):
    s = np.linspace(0, 1, 401)
    v, a = np.abs(shape.antiderivative(1)(s)).max(), np.abs(shape(s)).max()
    return max(np.max(np.abs(step) * v / speed), np.sqrt(np.max(np.abs(step) * a / acceleration)), 0.05)


def make_point_to_point(arm, rng, seconds, rate, shape=None, fast=0.9):
    """Moves of all joints at once between random points, at speeds from a fifth to all, with dwells."""
    t = np.arange(round(seconds * rate)) / rate
    middle, half = _middle(arm)
    here = middle + half * rng.uniform(-0.5, 0.5, len(half))
    start, moves, now = here, [], 0.3
    while now < seconds:
        target = middle + half * rng.uniform(-1, 1, len(half))
        form = shape or (make_quintic() if rng.random() < 0.5 else make_trapezoid(rng.uniform(0.2, 0.4)))
        level = fast * rng.uniform(0.25, 1.0)
        duration = _duration(
            form, target - here, level * arm.column("speed"), level * arm.column("acceleration")
        )
        moves.append((now, duration, here, target, form))
        here, now = target, now + duration + rng.uniform(0.1, 0.8)
    return _play(t, moves, start)


def make_sweeps(arm, rng, seconds, rate, fast=0.9):
    """One joint after another to and fro, at speeds from a tenth to `fast` of the largest."""
    t = np.arange(round(seconds * rate)) / rate
    middle, half = _middle(arm)
    n = len(half)
    here = middle + half * rng.uniform(-0.3, 0.3, n)
    start, moves, now, k = here, [], 0.3, 0
    order = rng.permutation(n)
    share = (seconds - 0.5) / n
    for k, j in enumerate(order):
        side = 1.0
        while True:
            target = here.copy()
            target[j] = middle[j] + side * half[j] * rng.uniform(0.5, 1.0)
            level = fast * rng.choice([0.12, 0.25, 0.5, 1.0])
            form = make_trapezoid(0.15)
            room = 0.3 + (k + 1) * share - now
            quickest = _duration(
                form, target - here, fast * arm.column("speed"), fast * arm.column("acceleration")
            )
            duration = quickest / level * fast
            if duration > room:
                duration = quickest
            if duration > room:
                break
            moves.append((now, duration, here, target, form))
            here, now, side = target, now + duration + 0.15, -side
        now = 0.3 + (k + 1) * share
    return _play(t, moves, start)


KINDS = {"fourier": make_fourier, "points": make_point_to_point, "sweeps": make_sweeps}
