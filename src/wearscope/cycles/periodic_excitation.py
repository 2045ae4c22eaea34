"""Test-cycle of periodic excitation: Fourier series of all axes, once large and fast, once small and slow.

Swevers et al., "Optimal robot excitation and identification", IEEE Transactions on Robotics and Automation
13(5), 1997, with fixed coefficients in place of optimised ones.
"""

from functools import partial

import numpy as np

from wearscope.cycles.base import Cycle, Reference
from wearscope.cycles.motion import MotionPlan
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Array

HARMONICS = np.arange(1, 4)
# Share of the excursion that each of the two runs fills. Both have the same frequency, so the small one is
# slow.
SIZES = (0.6, 0.1)
# Share of the limits on speed, acceleration and jerk that the larger run reaches.
EFFORT = 0.6
# Phase of one period [rad]; time of the smooth start, and of the stop, in units of the frequency's inverse
# [rad].
TURN, RISE = 2.0 * np.pi, 0.3 * np.pi


def _coefficients(n: int) -> tuple[Array, Array]:
    """Return sine and cosine coefficients (n, H), of equal amplitude in speed.

    The golden ratio spreads the phases evenly over joints and harmonics.
    """
    count = len(HARMONICS)
    turns = np.mod(0.6180339887498949 * np.arange(1, count * n + 1).reshape(n, count), 1.0)
    return np.sin(2.0 * np.pi * turns) / HARMONICS, np.cos(2.0 * np.pi * turns) / HARMONICS


def _series(phase: Array, n: int, order: int) -> Array:
    """Return the derivative (k, n) of the series with respect to the phase (k,) [rad], of a given order."""
    sine, cosine = _coefficients(n)
    argument = np.multiply.outer(phase, HARMONICS) + 0.5 * np.pi * order
    weight = HARMONICS.astype(float) ** order
    return (weight * np.sin(argument)) @ sine.T + (weight * np.cos(argument)) @ cosine.T


def _phase(time: Array) -> tuple[Array, Array, Array]:
    """Return the phase [rad], its rate and the slope of the rate at times (k,) in units of 1 / frequency.

    The rate rises smoothly from 0 at the run's start to 1, and falls back to 0 at its end.
    """
    total = TURN + RISE
    x = np.clip(np.minimum(time, total - time) / RISE, 0.0, 1.0)
    # The rate is the smooth step 10 x^3 - 15 x^4 + 6 x^5; slope and phase are its derivative and integral.
    rate = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
    slope = np.where(time < 0.5 * total, 1.0, -1.0) * 30.0 * (x * (1.0 - x)) ** 2 / RISE
    covered = RISE * x**4 * (2.5 - 3.0 * x + x * x)
    phase = np.where(time < RISE, covered, np.where(time > total - RISE, TURN - covered, time - 0.5 * RISE))
    return phase, rate, slope


def _follow(time: Array, centre: Array, scale: Array, frequency: float) -> tuple[Array, Array, Array]:
    """Return position, speed and acceleration (k, n) at times (k,) [s] of a run; `frequency` in rad/s."""
    phase, rate, slope = _phase(frequency * time)
    zeroth, first, second = (_series(phase, len(centre), order) for order in range(3))
    speed = scale * first * (frequency * rate)[:, None]
    acceleration = scale * (second * (rate * rate)[:, None] + first * slope[:, None]) * frequency * frequency
    return centre + scale * zeroth, speed, acceleration


def _find_frequency(plan: MotionPlan, scale: Array) -> float:
    """Return the largest base frequency [rad/s] at which every axis stays within `EFFORT` of its limits."""
    time = np.linspace(0.0, TURN + RISE, 4001)
    _, speed, acceleration = _follow(time, np.zeros(plan.n), scale, 1.0)
    jerk = np.diff(acceleration, axis=0) / np.diff(time)[:, None]
    # Speed, acceleration and jerk grow with the first, second and third power of the frequency. A joint
    # without range does not move and gives a division by zero.
    with np.errstate(divide="ignore"):
        return min(
            float(np.min(EFFORT * limit / np.abs(values).max(axis=0))) ** (1.0 / power)
            for power, (limit, values) in enumerate(
                ((plan.speed, speed), (plan.acceleration, acceleration), (plan.jerk, jerk)), start=1
            )
        )


def build(model: RobotModel, dwell: float, step: float) -> Reference:
    """Follow one period of the series twice, large and small, each with a smooth start and stop."""
    plan = MotionPlan(model, dwell, step)
    shape = _series(np.linspace(0.0, TURN, 2001), plan.n, 0)
    middle, half = 0.5 * (shape.max(axis=0) + shape.min(axis=0)), 0.5 * np.ptp(shape, axis=0)
    frequency = _find_frequency(plan, max(SIZES) * plan.excursion() / half)
    for size in SIZES:
        scale = size * plan.excursion() / half
        follow = partial(_follow, centre=plan.home - scale * middle, scale=scale, frequency=frequency)
        start = follow(np.zeros(1))[0][0]
        plan.move_to(start, 0.5)
        plan.run((TURN + RISE) / frequency, follow, start)
    plan.move_to(plan.home, 0.5)
    return plan.finish()


CYCLE = Cycle(
    "periodic_excitation",
    "Fourier series of three harmonics on all axes, large and fast, then small and slow.",
    build,
)
