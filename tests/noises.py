"""Noise of a motor torque that owes nothing to the motion: `extra_torque` of recordings, (N, n) [N m]."""

import numpy as np
from scipy import signal


def white(t, q, v, a, rng):
    """Nothing beyond what the recording has."""
    return 0.0 * q


def coloured(t, q, v, a, rng):
    """With a memory of 60 ms."""
    return signal.lfilter([0.3], [1.0, -np.exp(-1 / 12)], 4.0 * rng.standard_normal(q.shape), axis=0)


def slow(t, q, v, a, rng):
    """With a memory of a second, as the motion has."""
    return signal.lfilter([0.07], [1.0, -np.exp(-1 / 200)], 10.0 * rng.standard_normal(q.shape), axis=0)


def drift(t, q, v, a, rng):
    """A random walk."""
    return 0.05 * np.cumsum(rng.standard_normal(q.shape), axis=0)


def heavy(t, q, v, a, rng):
    """With heavy tails."""
    return 0.8 * rng.standard_t(3, q.shape)


def turning(t, q, v, a, rng):
    """A torque by the place where the joint last turned round, which is no noise."""
    turned = np.concatenate([[False], (v[1:, 0] > 0.0) != (v[:-1, 0] > 0.0)])
    last = np.maximum.accumulate(np.where(turned, np.arange(len(t)), 0))
    return np.column_stack([q[last, 0], 0.0 * t])
