"""Motions of the board: the demonstration's, and two kinds more."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from wearscope.demonstration import motions as demonstration
from wearscope.demonstration.motions import Machine, Motion, add_move, move_time

Array = NDArray[np.float64]


def repeat_cycle(machine: Machine, rng: np.random.Generator, t: Array) -> Motion:
    """Industrial cycle: a few poses visited over and over at the same speeds, with the same dwells."""
    n = len(machine.joints)
    q, v, a = (np.zeros((len(t), n)) for _ in range(3))
    reach, poses = np.asarray(machine.reach), int(rng.integers(3, 6))
    places = rng.uniform(-0.9, 0.9, (poses, n)) * reach
    shares = rng.choice([0.5, 0.8, 1.0], poses)
    dwells = np.where(rng.uniform(size=poses) < 0.4, rng.uniform(0.2, 0.8, poses), 0.02)
    clock, at, visit = 0.4, np.zeros(n), 0
    while True:
        by, share = places[visit % poses] - at, float(shares[visit % poses])
        time = max(
            move_time(b, share * s, c, 0.4)
            for b, s, c in zip(by, machine.speed, machine.acceleration, strict=True)
        )
        if clock + time > t[-1] - 0.4:
            break
        for j in range(n):
            add_move(q[:, j], v[:, j], a[:, j], t, clock, time, 0.4, float(by[j]))
        at, clock, visit = at + by, clock + time + float(dwells[visit % poses]), visit + 1
    return Motion(t, q + np.asarray(machine.centre), v, a)


def pass_through_points(machine: Machine, rng: np.random.Generator, t: Array) -> Motion:
    """Smooth motion through drawn poses without a stop (a spline of degree 7), from rest to rest."""
    n = len(machine.joints)
    pace = float(rng.uniform(0.6, 1.5))
    count = max(4, round((t[-1] - 0.8) / pace))
    knots = np.concatenate([[0.0], np.linspace(0.4, t[-1] - 0.4, count), [t[-1]]])
    places = rng.uniform(-1.0, 1.0, (len(knots), n))
    places[[0, 1, -2, -1]] = 0.0
    still = [(order, np.zeros(n)) for order in (1, 2, 3)]
    spline = make_interp_spline(knots, places, k=7, bc_type=(still, still))
    q, v, a = (spline.derivative(order)(t) if order else spline(t) for order in range(3))
    limits = np.asarray(machine.reach), np.asarray(machine.speed), np.asarray(machine.acceleration)
    scale = np.min(
        [limit / np.abs(x).max(axis=0) for limit, x in zip(limits, (q, v, a), strict=True)], axis=0
    )
    return Motion(t, scale * q + np.asarray(machine.centre), scale * v, scale * a)


KINDS = {
    **demonstration.KINDS,
    "cycle": repeat_cycle,
    "through": pass_through_points,
}


def make_motion(
    machine: Machine, kind: str, seed: int, duration: float, rate: float, locked: tuple[str, ...] = (),
    pace: float = 1.0,
) -> Motion:  # fmt: skip
    """Motion of a kind, the same for the same seed.

    Parameters
    ----------
    machine : Machine
    kind : str
        One of `KINDS`.
    seed : int
        Entropy of the motion alone, so that two runs may repeat one trajectory.
    duration, rate : float
        Length [s] and grid [Hz].
    locked : tuple of str
        Joints that stay where they are.
    pace : float
        Share of the machine's speed that the motion may use; of its acceleration the square of it.
    """
    if pace != 1.0:
        machine = replace(
            machine,
            speed=tuple(pace * x for x in machine.speed),
            acceleration=tuple(pace**2 * x for x in machine.acceleration),
        )
    t = np.arange(round(duration * rate)) / rate
    motion = KINDS[kind](machine, np.random.default_rng(np.random.SeedSequence(seed)), t)
    for joint in locked:
        j = machine.joints.index(joint)
        motion.q[:, j], motion.v[:, j], motion.a[:, j] = machine.centre[j], 0.0, 0.0
    return motion
