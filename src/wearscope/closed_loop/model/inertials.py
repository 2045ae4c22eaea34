"""Inertial parameters: the prior where they may be wrong, and the consistent ones nearest to an estimate."""

import numpy as np
from scipy import optimize
from scipy.linalg import block_diag

from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.effects.base import Effect, InertialEffect, PayloadEffect
from wearscope.robots.spatial import pseudo_inertia

#: Usual error of an inertial parameter, as a share of its link's own scale.
USUAL_ERROR = 0.3
#: Share of the stated pseudo-inertia that a link keeps, as simulators need positive ones; smallest eigenvalue
#: of a root from which the fit starts, over the largest one.
_LEAST = 1e-4


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


def _read_parameters(p: np.ndarray) -> np.ndarray:
    """Ten inertial parameters (..., 10) of pseudo-inertias (..., 4, 4), in which they are linear."""
    sigma = p[..., :3, :3]
    tensor = np.trace(sigma, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - sigma
    entries = [tensor[..., i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
    return np.stack([p[..., 3, 3], *(p[..., k, 3] for k in range(3)), *entries], axis=-1)


def _find_root(p: np.ndarray) -> np.ndarray:
    """Square root (4, 4) of a pseudo-inertia, of the nearest one that is positive definite."""
    values, vectors = np.linalg.eigh(p)
    return np.asarray(vectors * np.sqrt(np.maximum(values, _LEAST * values.max() + 1e-12)) @ vectors.T)


def is_consistent(parameters: np.ndarray) -> bool:
    """Whether every link's pseudo-inertia is positive semi-definite (Wensing et al. 2018)."""
    return all(np.linalg.eigvalsh(pseudo_inertia(link)).min() >= 0 for link in parameters.reshape(-1, 10))


def nearest_consistent(free: np.ndarray, start: np.ndarray, hessian: np.ndarray) -> np.ndarray:
    """Physically consistent parameters that increase the loss least over an estimate without constraint.

    Parameters
    ----------
    free : ndarray (10 n,)
        Estimate without the constraint.
    start : ndarray (10 n,)
        Parameters to start from, the URDF's.
    hessian : ndarray (10 n, 10 n)
        Hessian of the loss at the free estimate, prior included.

    Returns
    -------
    ndarray (10 n,)
        `free` itself where it is consistent; else the minimum over factors A of the pseudo-inertias A A'
        (Burer and Monteiro 2003), which reach the singular ones at which it lies.
    """
    if is_consistent(free):
        return free
    stated = np.array([pseudo_inertia(link) for link in start.reshape(-1, 10)])
    x0 = np.array([_find_root(p) for p in stated])
    weight = np.linalg.cholesky(hessian + 1e-12 * np.trace(hessian) / len(hessian) * np.eye(len(hessian))).T
    entries = np.eye(16).reshape(16, 4, 4)

    def build(x: np.ndarray) -> np.ndarray:
        factors = x.reshape(-1, 4, 4)
        return _read_parameters(factors @ factors.transpose(0, 2, 1) + _LEAST * stated).ravel()

    def differentiate(x: np.ndarray) -> np.ndarray:
        product = entries @ x.reshape(-1, 1, 4, 4).transpose(0, 1, 3, 2)
        slopes = _read_parameters(product + product.transpose(0, 1, 3, 2)).transpose(0, 2, 1)
        return np.asarray(weight @ block_diag(*slopes) / scale)

    scale = max(np.linalg.norm(weight @ (build(x0) - free)), 1e-12)
    found = optimize.least_squares(
        lambda x: weight @ (build(x) - free) / scale, x0.ravel(), differentiate, max_nfev=500
    )
    return build(found.x)
