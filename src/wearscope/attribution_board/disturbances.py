"""What a recording has besides the machine: torque noise of several kinds, encoder error, sampling jitter."""

import numpy as np
from numpy.typing import NDArray

from wearscope.errors import InputError

Array = NDArray[np.float64]

NOISES = ("plain", "coloured", "drift", "jitter", "heavy", "hum", "event")
"""Kinds of disturbance. All are free of any effect: nothing in them follows the motion."""


def check_noise(kind: str) -> None:
    """Refuse an unknown kind of noise.

    Raises
    ------
    InputError
        Naming the kinds there are.
    """
    if kind not in NOISES:
        raise InputError(f"attribution board: there is no noise '{kind}'; choose one of {', '.join(NOISES)}.")


def _scaled(x: Array, rms: Array) -> Array:
    return x / np.sqrt(np.mean(x**2, axis=0)) * rms


def make_noise(kind: str, rows: int, rms: Array, rate: float, rng: np.random.Generator) -> Array:
    """Torque noise (rows, n) of root mean square `rms` (n,) by joint.

    Parameters
    ----------
    kind : str
        ``plain`` white; ``coloured`` first-order autoregressive with 60 ms memory; ``drift`` white plus a
        bias walking at random; ``jitter`` white (the channels' timing jitters, see `jitter_times`); ``heavy``
        Student t with 3 degrees of freedom; ``hum`` white plus a sine in time with a phase of its own in each
        run; ``event`` white plus one short knock at a drawn moment.
    rows : int
    rms : array (n,)
        [torque unit of the joint]
    rate : float
        [Hz]
    rng : numpy Generator
    """
    check_noise(kind)
    n = len(rms)
    white = rng.normal(size=(rows, n))
    if kind in ("plain", "jitter"):
        return white * rms
    if kind == "coloured":
        keep = np.exp(-1.0 / (0.06 * rate))
        out = np.empty_like(white)
        state = rng.normal(size=n)
        drive = np.sqrt(1 - keep**2)
        for i in range(rows):
            state = keep * state + drive * white[i]
            out[i] = state
        return out * rms
    if kind == "heavy":
        return rng.standard_t(3, size=(rows, n)) / np.sqrt(3.0) * rms
    t = np.arange(rows) / rate
    if kind == "drift":
        walk = np.cumsum(rng.normal(size=(rows, n)), axis=0)
        walk -= walk[rng.integers(rows)]
        return _scaled(0.8 * white + 0.6 * _scaled(walk, np.ones(n)), rms)
    if kind == "hum":
        frequency, phase = rng.uniform(3.0, 9.0), rng.uniform(0, 2 * np.pi, n)
        return _scaled(0.8 * white + 0.85 * np.sin(2 * np.pi * frequency * t[:, None] + phase), rms)
    moment = rng.uniform(0.2, 0.8, n) * t[-1]
    knock = np.exp(-(((t[:, None] - moment) / 0.15) ** 2)) * rng.choice([-1.0, 1.0], n)
    return _scaled(white + 6.0 * knock, rms)


def jitter_times(t: Array, kind: str, rate: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Moments at which the position and the torque channel were really sampled (both `t` unless ``jitter``).

    The standard deviations, 1 % and 5 % of a sample, are those of a recorder that stamps whole cycles.
    """
    if kind != "jitter":
        return t, t
    return (
        t + rng.normal(size=len(t)) * 0.01 / rate,
        t + rng.normal(size=len(t)) * 0.05 / rate,
    )


def quantise(q: Array, resolution: Array, rng: np.random.Generator) -> Array:
    """Encoder reading (N, n): half a count of noise, then rounding to `resolution` (n,)."""
    return np.round((q + rng.normal(size=q.shape) * 0.5 * resolution) / resolution) * resolution
