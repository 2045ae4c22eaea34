"""Prior of the inertial parameters, where they are refitted or may be wrong."""

import numpy as np

from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.effects.base import Effect, InertialEffect, PayloadEffect, load_effect

#: Usual error of an inertial parameter, as a share of its link's own scale.
USUAL_ERROR = 0.3


def inertial_scale(prepared: Prepared) -> np.ndarray:
    """Usual size of an error of each inertial parameter, (10 n,): `USUAL_ERROR` of its link's own scale."""
    body = prepared.runs[0].signals.rigid_body
    parameters = body.inertial_parameters.reshape(-1, 10)
    mass = np.maximum(parameters[:, 0], 0.02 * parameters[:, 0].max() + 1e-6)
    # The trace of the inertia is twice the mass times the mean square lever.
    trace = parameters[:, 4] + parameters[:, 6] + parameters[:, 9]
    lever = np.sqrt(np.maximum(trace / mass, 1e-4))
    scale = np.column_stack([mass] + [mass * lever] * 3 + [mass * lever**2] * 6)
    return USUAL_ERROR * scale.ravel()


def name_far_links(prepared: Prepared, deviations: np.ndarray, errors: float) -> list[tuple[str, str]]:
    """Each joint whose link's refitted inertials are far from the URDF's, and a sentence.

    Parameters
    ----------
    prepared : Prepared
    deviations : ndarray (10 n,)
        Of the refitted inertial parameters from the URDF's.
    errors : float
        Standard deviations a priori beyond which they are.
    """
    parameters = load_effect("payload_error").coefficients
    off = deviations.reshape(-1, 10)
    far = np.abs(off) > errors * inertial_scale(prepared).reshape(-1, 10)
    found = []
    for joint, own, beyond in zip(prepared.dataset.joints, off, far, strict=True):
        changes = [f"{parameters[k].name} {own[k]:+.3g} {parameters[k].unit}" for k in np.flatnonzero(beyond)]
        if changes:
            told = (
                f"the link that {joint} moves was refitted far from the URDF ({', '.join(changes)}: more "
                f"than {errors:g} times {100 * USUAL_ERROR:g} % of its own scale); a load, balancer or "
                "drive's inertia that is not declared may cause it."
            )
            found.append((joint, told))
    return found


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
