"""Prior of the inertial parameters, where they are refitted or may be wrong."""

import numpy as np

from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.effects.base import Effect, InertialEffect, PayloadEffect


def inertial_scale(prepared: Prepared) -> np.ndarray:
    """Usual size of an error of each inertial parameter, (10 n,): 30 % of each link's own scale."""
    body = prepared.runs[0].signals.rigid_body
    parameters = body.inertial_parameters.reshape(-1, 10)
    mass = np.maximum(parameters[:, 0], 0.02 * parameters[:, 0].max() + 1e-6)
    # The trace of the inertia is twice the mass times the mean square lever.
    trace = parameters[:, 4] + parameters[:, 6] + parameters[:, 9]
    lever = np.sqrt(np.maximum(trace / mass, 1e-4))
    scale = np.column_stack([mass] + [mass * lever] * 3 + [mass * lever**2] * 6)
    return 0.3 * scale.ravel()


def inertial_penalty(prepared: Prepared) -> np.ndarray:
    """Prior precision (10 n, 10 n) of deviations of the inertial parameters from the URDF's."""
    return np.diag(1.0 / inertial_scale(prepared) ** 2)


def payload_penalty(prepared: Prepared) -> np.ndarray:
    """Prior precision (10, 10) of a payload's parameters: that of the robot's heaviest link."""
    scale = inertial_scale(prepared).reshape(-1, 10).max(axis=0)
    return np.diag(1.0 / scale**2)


def find_penalty(prepared: Prepared, effect: Effect) -> np.ndarray | None:
    """Prior precision of the coefficients of an effect that adds bodies; None for any other."""
    if isinstance(effect, InertialEffect):
        return inertial_penalty(prepared)
    return payload_penalty(prepared) if isinstance(effect, PayloadEffect) else None
