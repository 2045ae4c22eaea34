"""Noise of a torque channel with unit standard deviation."""

import numpy as np
from scipy.signal import lfilter


def make_noise(kind, rng, m, n, rate, memory=0.03):
    """Noise (m, n) of unit standard deviation: white, coloured, hum, heavy or drift.

    Parameters
    ----------
    kind : str
    rng : Generator
    m, n : int
    rate : float
        [Hz]
    memory : float
        Of coloured noise [s].
    """
    white = rng.normal(size=(m, n))
    if kind == "white":
        return white
    if kind == "coloured":
        return _colour(white, memory, rate)
    if kind == "heavy":
        return rng.standard_t(3, size=(m, n)) / np.sqrt(3.0)
    t = np.arange(m)[:, None] / rate
    if kind == "hum":
        line = 50.0 * (1 + 2e-4 * rng.normal())
        hum = sum(
            np.sqrt(2.0) * size * np.sin(2 * np.pi * k * line * t + rng.uniform(0, 6.3, n))
            for k, size in ((1, 0.8), (2, 0.5), (3, 0.2))
        )
        return (hum + 0.4 * white) / np.sqrt(0.93 + 0.16)
    if kind == "drift":
        return 0.7 * white + 0.7 * _colour(rng.normal(size=(m, n)), 4.0, rate)
    raise ValueError(f"no noise {kind}")


def _colour(white, memory, rate):
    a = np.exp(-1.0 / (memory * rate))
    start = white[:1] * a
    return lfilter([np.sqrt(1 - a**2)], [1, -a], white, axis=0, zi=start)[0]
