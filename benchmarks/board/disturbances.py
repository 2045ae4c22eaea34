"""What a recording has next to the machine: torque noise of several kinds, encoder error, sampling jitter."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from wearscope.errors import InputError

Array = NDArray[np.float64]

NOISES = ("plain", "coloured", "drift", "jitter", "heavy", "hum", "event", "harmonics")
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


def make_noise(
    kind: str, rows: int, rms: Array, rate: float, rng: np.random.Generator,
    memory: float = 0.06, frequency: float | None = None,
) -> Array:  # fmt: skip
    """Torque noise (rows, n) of root mean square `rms` (n,) by joint.

    Parameters
    ----------
    kind : str
        ``plain`` white; ``coloured`` first-order autoregressive; ``drift`` white plus a
        bias walking at random; ``jitter`` white (the channels' timing jitters, see `jitter_times`); ``heavy``
        Student t with 3 degrees of freedom; ``hum`` white plus a sine in time with a phase of its own in each
        run; ``event`` white plus one short knock at a drawn moment; ``harmonics`` white plus a hum with its
        second and third harmonics whose strength waxes and wanes.
    rows : int
    rms : array (n,)
        [torque unit of the joint]
    rate : float
        [Hz]
    rng : numpy Generator
    memory : float
        Time constant of ``coloured`` noise [s].
    frequency : float, optional
        Of the hum [Hz]; drawn from 3 to 9 where left out. It is kept below 0.45 of the rate.
    """
    check_noise(kind)
    n = len(rms)
    white = rng.normal(size=(rows, n))
    if kind in ("plain", "jitter"):
        return white * rms
    if kind == "coloured":
        keep = np.exp(-1.0 / (memory * rate))
        start = keep * rng.normal(size=(1, n))
        out, _ = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], white, axis=0, zi=start)
        return np.asarray(out) * rms
    if kind == "heavy":
        return rng.standard_t(3, size=(rows, n)) / np.sqrt(3.0) * rms
    t = np.arange(rows) / rate
    if kind == "drift":
        walk = np.cumsum(rng.normal(size=(rows, n)), axis=0)
        walk -= walk[rng.integers(rows)]
        return _scaled(0.8 * white + 0.6 * _scaled(walk, np.ones(n)), rms)
    if kind == "hum":
        drawn, phase = rng.uniform(3.0, 9.0), rng.uniform(0, 2 * np.pi, n)
        frequency = min(drawn if frequency is None else frequency, 0.45 * rate)
        return _scaled(0.8 * white + 0.85 * np.sin(2 * np.pi * frequency * t[:, None] + phase), rms)
    if kind == "harmonics":
        frequency = min(rng.uniform(3.0, 9.0) if frequency is None else frequency, 0.15 * rate)
        wave = np.zeros((rows, n))
        for order, share in ((1, 1.0), (2, 0.6), (3, 0.35)):
            wave += share * np.sin(2 * np.pi * order * frequency * t[:, None] + rng.uniform(0, 2 * np.pi, n))
        swell = 1.0 + 0.5 * np.sin(
            2 * np.pi * rng.uniform(0.1, 0.4) * t[:, None] + rng.uniform(0, 2 * np.pi, n)
        )
        return _scaled(0.8 * white + 0.85 * swell * wave, rms)
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
