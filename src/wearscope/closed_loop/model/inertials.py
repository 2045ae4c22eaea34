"""Inertial parameters: the prior where they may be wrong, and the consistent ones nearest to an estimate."""

import numpy as np
from scipy import optimize

from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.effects.base import Effect, InertialEffect, PayloadEffect, load_effect
from wearscope.robots.spatial import pseudo_inertia

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


def _from_factor(x: np.ndarray) -> np.ndarray:
    """Ten inertial parameters of the pseudo-inertia L L' with log-diagonal lower factor L."""
    factor = np.zeros((4, 4))
    factor[np.tril_indices(4)] = x
    factor[np.diag_indices(4)] = np.exp(np.diag(factor))
    p = factor @ factor.T
    sigma, h, m = p[:3, :3], p[:3, 3], p[3, 3]
    tensor = np.trace(sigma) * np.eye(3) - sigma
    return np.array(
        [m, *h, tensor[0, 0], tensor[0, 1], tensor[1, 1], tensor[0, 2], tensor[1, 2], tensor[2, 2]]
    )


def _to_factor(parameters: np.ndarray) -> np.ndarray:
    p = pseudo_inertia(parameters)
    values, vectors = np.linalg.eigh(p)
    floor = max(1e-4 * values.max(), 1e-9)
    factor = np.linalg.cholesky(vectors @ np.diag(np.maximum(values, floor)) @ vectors.T)
    factor[np.diag_indices(4)] = np.log(np.diag(factor))
    return factor[np.tril_indices(4)]


def is_consistent(parameters: np.ndarray) -> bool:
    """Whether every link's pseudo-inertia is positive semi-definite (Wensing et al. 2018)."""
    return all(np.linalg.eigvalsh(pseudo_inertia(link)).min() >= 0 for link in parameters.reshape(-1, 10))


def nearest_consistent(free: np.ndarray, start: np.ndarray, hessian: np.ndarray) -> np.ndarray:
    """Consistent parameters that lose least of the fit.

    Parameters
    ----------
    free : ndarray (10 n,)
        Estimate without the constraint.
    start : ndarray (10 n,)
        Parameters to start from, the URDF's.
    hessian : ndarray (10 n, 10 n)
        Of the loss at the free estimate, prior included.

    Returns
    -------
    ndarray (10 n,)
        `free` itself where it is consistent; else the minimum over log-Cholesky factors of the
        pseudo-inertias (Rucker and Wensing 2022).
    """
    if is_consistent(free):
        return free
    links = start.reshape(-1, 10)
    x0 = np.concatenate([_to_factor(link) for link in links])
    weight = np.linalg.cholesky(hessian + 1e-12 * np.trace(hessian) / len(hessian) * np.eye(len(hessian)))

    def residual(x: np.ndarray) -> np.ndarray:
        parameters = np.concatenate([_from_factor(part) for part in x.reshape(-1, 10)])
        return weight.T @ (parameters - free)

    scale = max(np.linalg.norm(residual(x0)), 1e-12)
    result = optimize.least_squares(lambda x: residual(x) / scale, x0, max_nfev=200)
    return np.concatenate([_from_factor(part) for part in result.x.reshape(-1, 10)])
