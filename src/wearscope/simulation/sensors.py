"""Sensors of a drive: encoder steps, gain, delay and noise of the torque, and the sample rate."""

import hashlib

import numpy as np

from wearscope.errors import InputError
from wearscope.robots.spatial import Array
from wearscope.simulation.recording import Recording
from wearscope.simulation.run import Trace

#: A drive computes its speed from the encoder positions this time [s] before and after a sample.
SPEED_TIME = 1e-3
#: A sampling interval may differ from a whole number of steps by this share.
_WHOLE = 1e-6


def seed_of(root: int, *identity: object) -> np.random.SeedSequence:
    """Return a seed that depends on the root seed and on the given names alone.

    Parameters
    ----------
    root : int
    *identity
        What the seed is for, e.g. robot, test-cycle, set and point.
    """
    digest = hashlib.sha256("\0".join(str(part) for part in identity).encode()).digest()
    words = np.frombuffer(digest, dtype="<u4")
    return np.random.SeedSequence(entropy=int(root), spawn_key=tuple(int(word) for word in words))


def find_stride(dt: float, sample_rate: float) -> int:
    """Return the number of steps between two samples.

    Raises
    ------
    InputError
        Where the sampling interval is no whole number of steps.
    """
    stride = round(1.0 / (dt * sample_rate))
    if stride < 1 or abs(stride * dt * sample_rate - 1.0) > _WHOLE:
        raise InputError(
            f"sample_rate {sample_rate:g} Hz is no whole number of steps of {dt:g} s; choose a step that "
            "divides the sample time."
        )
    return stride


def check_rate(dt: float, sample_rate: float) -> None:
    """Raise InputError where the sample rate exceeds the rate of the simulation's steps."""
    if dt * sample_rate > 1.0 + _WHOLE:
        raise InputError(
            f"sample_rate {sample_rate:g} Hz is above the {1.0 / dt:g} steps a second that are simulated; "
            "choose a shorter simulation.step, or a lower rate."
        )


def lag_torque(torque: Array, delay: Array, dt: float) -> Array:
    """Return the torque (N, n) delayed by `delay` (n,) [s]: interpolated linearly, held at the ends."""
    if not np.any(delay):
        return torque
    steps = np.arange(len(torque), dtype=float)
    return np.column_stack(
        [np.interp(steps - delay[j] / dt, steps, torque[:, j]) for j in range(torque.shape[1])]
    )


def _encode(position: Array, resolution: Array) -> Array:
    """Round positions (N, n) to whole encoder steps; a joint with resolution 0 keeps its positions."""
    exact = resolution == 0.0
    steps = np.where(exact, 1.0, resolution)
    encoded = position / steps
    np.rint(encoded, out=encoded)
    encoded *= steps
    if exact.any():
        encoded[:, exact] = position[:, exact]
    return encoded


def record(
    trace: Trace,
    dt: float,
    sample_rate: float,
    encoder_resolution: Array,
    torque_noise: Array,
    torque_gain: Array,
    torque_delay: Array,
    seed: int | np.random.SeedSequence | None,
) -> Recording:
    """Record a run as a drive does: all signals are sampled at the same instants, without a filter.

    Positions are rounded to encoder steps. Speeds are the difference of the encoder positions `SPEED_TIME`
    before and after. Torques are the motor's, with gain error, delay and white noise.

    Parameters
    ----------
    trace : Trace
    dt, sample_rate : float
        Step [s] and samples a second [Hz].
    encoder_resolution : ndarray (n,)
        Encoder step [rad or m]; 0 does not round.
    torque_noise : ndarray (n,)
        Standard deviation [N m or N].
    torque_gain : ndarray (n,)
        Relative gain error [-].
    torque_delay : ndarray (n,)
        [s]
    seed : int or SeedSequence or None
        Seed of the noise; None records without noise.

    Raises
    ------
    InputError
        Where there are more samples than steps.
    """
    count = len(trace.torque)
    torque = lag_torque(trace.torque, torque_delay, dt)
    if np.any(torque_gain):
        torque = torque * (1.0 + torque_gain)
    t, q, v, tau = _sample((trace.t, trace.q[:count], trace.v, torque), dt, sample_rate)
    moved = SPEED_TIME * v
    speed = (_encode(q + moved, encoder_resolution) - _encode(q - moved, encoder_resolution)) / (
        2.0 * SPEED_TIME
    )
    if seed is not None:
        rng = np.random.default_rng(seed)
        noise = rng.standard_normal(tau.shape)
        noise *= torque_noise
        tau += noise
    return Recording(t=t, q=_encode(q, encoder_resolution), qd=speed, tau=tau)


def _sample(signals: tuple[Array, Array, Array, Array], dt: float, sample_rate: float) -> list[Array]:
    """Return time, position, speed and torque at the recorded instants, interpolated between steps.

    Positions follow the cubic through the steps' positions and speeds. Speed and torque are interpolated
    linearly, with an error of second order in the step.
    """
    check_rate(dt, sample_rate)
    every = 1.0 / (dt * sample_rate)
    if abs(round(every) / every - 1.0) <= _WHOLE:
        return [values[:: round(every)].copy() for values in signals]
    # Imported only here: the import takes as long as the simulation of several points.
    from scipy.interpolate import CubicHermiteSpline, make_interp_spline

    t, q, v, torque = signals
    steps = np.arange(len(t), dtype=float)
    at = np.arange(0.0, steps[-1] + _WHOLE, every)
    between = make_interp_spline(steps, np.column_stack([t, v, torque]), k=1)(at)
    n = q.shape[1]
    position = CubicHermiteSpline(steps, q, dt * v)(at)
    return [between[:, 0], position, between[:, 1 : 1 + n], between[:, 1 + n :]]
