"""What separates a recorded torque from the true model along the measured motion.

Whoever explains a record knows the positions as they were recorded: rounded, noisy, and sampled. What they
do to the torque of a model, through speeds and accelerations, stands between the record and the truth like
the noise of the torque itself. With T the torque that the machine's motors are asked for along a motion, were
the gears rigid and the record in time, m the measured motion below the common band's edge, and f what the
gears' bending and lost motion are worth, the separation is

    n = recorded torque - T(m) - f

(a delay undone first). Where a joint rests, and at the ends of a run, where no filter knows the acceleration,
T is taken along the exact motion.

A motor crosses a lost motion in less time than a recorder samples. Sampled as it is, f would be a few lone
peaks whose height is chance, and most of whose energy is folded down from above half the sample rate, where
no recorded position can show it; what a record holds of f is what lies below. What such peaks are to the
recorded torque through the rotor's inertia is part of n.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from benchmarks.board.features import CUTOFF_HZ, REST
from benchmarks.board.machines import Body
from benchmarks.board.physics import (
    Active,
    Behaviour,
    Setting,
    Structural,
    ask_torque,
    behave,
    find_body,
)
from wearscope.demonstration.motions import Motion

Array = NDArray[np.float64]

BENDS = ("joint_elasticity", "backlash")
"""Effects that put the motor ahead of the link."""
KNOWN_SHARE = 0.4
"""Frequency up to which a sampled signal is known, of its sample rate."""
END_SECONDS = 0.15
"""How long at either end of a run no filter knows the acceleration."""


def bends(actives: Sequence[Active]) -> bool:
    """Whether one of these plants puts the motor ahead of the link."""
    return any(isinstance(a.plant, Structural) and a.plant.kind in BENDS for a in actives)


def sample(x: Array, rate: float, oversampling: int) -> Array:
    """What a record of some rate holds of a signal (N, n) on the fine grid: no more than it can tell."""
    if oversampling == 1:
        return x
    sos = butter(8, KNOWN_SHARE * rate, fs=rate * oversampling, output="sos")
    return np.asarray(sosfiltfilt(sos, x, axis=0))[::oversampling]


def measure_motion(t: Array, q: Array, rate: float) -> Motion:
    """Motion below the common band's edge that recorded positions (N, n) tell."""
    sos = butter(3, min(CUTOFF_HZ, KNOWN_SHARE * rate), fs=rate, output="sos")
    known = make_interp_spline(t, sosfiltfilt(sos, q, axis=0), k=5)
    return Motion(t, known(t), known.derivative(1)(t), known.derivative(2)(t))


def separate(
    setting: Setting, declared_body: Body, motion: Motion, behaviour: Behaviour, actives: Sequence[Active],
    oversampling: int, q: Array, tau: Array,
) -> Array:  # fmt: skip
    """Separation n (N, n) of one run, at the recorded rate and not yet smoothed.

    Parameters
    ----------
    setting : Setting
    declared_body : Body
    motion : Motion
        Of the links, on the fine grid, as it happened.
    behaviour : Behaviour
        What the machine did along it.
    actives : sequence of Active
        All plants.
    oversampling : int
        Steps of the fine grid by recorded sample.
    q, tau : array (N, n)
        Positions and torques as recorded.
    """
    every = slice(None, None, oversampling)
    t, fine = behaviour.t[every], 1.0 / (motion.t[1] - motion.t[0])
    rate = fine / oversampling
    body = find_body(setting, actives, declared_body)
    prompt = [a for a in actives if not (isinstance(a.plant, Structural) and a.plant.kind == "time_delay")]
    in_time = behaviour.tau
    if len(prompt) < len(actives):
        in_time = behave(setting, motion, behaviour.temperature, prompt, declared_body).tau
    exact = Motion(behaviour.t, behaviour.q, behaviour.v, behaviour.a)
    rigid = ask_torque(setting, prompt, body, exact, behaviour.temperature)
    known = ask_torque(setting, prompt, body, measure_motion(t, q, rate), behaviour.temperature[every])
    speed = np.abs(motion.v[every])
    unknown = speed <= REST * speed.max(axis=0)
    unknown |= (np.minimum(t - t[0], t[-1] - t) < END_SECONDS)[:, None]
    left = tau - (behaviour.tau - in_time)[every] - np.where(unknown, rigid[every], known)
    if bends(actives):
        left -= sample(in_time - rigid, rate, oversampling)
    return np.asarray(left)
