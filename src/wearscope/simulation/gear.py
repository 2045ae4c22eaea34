"""Deflection of a gear, ``compliance tau + lost_motion/2 tanh(tau/mesh_torque)``: its slope and inverse."""

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy", forceinline=True)
def deflection(torque, compliance, lost_motion, mesh_torque):
    """Deflection (motor minus link position) under a torque."""
    return compliance * torque + 0.5 * lost_motion * np.tanh(torque / mesh_torque)


@njit(cache=True, error_model="numpy", forceinline=True)
def deflection_slope(torque, compliance, lost_motion, mesh_torque):
    """Compliance at a torque."""
    take_up = np.cosh(min(abs(torque / mesh_torque), 300.0))
    return compliance + 0.5 * lost_motion / (mesh_torque * take_up * take_up)


@njit(cache=True, error_model="numpy", forceinline=True)
def invert_deflection(gap, compliance, lost_motion, mesh_torque):
    """Torque at a deflection.

    The law is concave beyond rest: Newton's method climbs to the root from a point short of it, which the
    steepest slope and the far asymptote give.
    """
    size = abs(gap)
    torque = max(
        size / (compliance + 0.5 * lost_motion / mesh_torque), (size - 0.5 * lost_motion) / compliance
    )
    if lost_motion > 0.0:
        for _ in range(100):
            change = (size - deflection(torque, compliance, lost_motion, mesh_torque)) / deflection_slope(
                torque, compliance, lost_motion, mesh_torque
            )
            torque += change
            if abs(change) <= 1e-14 * torque:
                break
    return np.copysign(torque, gap)
