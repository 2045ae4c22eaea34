"""Physically consistent inertial parameters nearest to a free estimate."""

import numpy as np
from scipy import optimize

from wearscope.robots.spatial import pseudo_inertia


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
