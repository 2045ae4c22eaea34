"""Consistent inertial parameters nearest to an estimate."""

import numpy as np
import pytest

from wearscope.closed_loop.model.inertials import is_consistent, nearest_consistent
from wearscope.robots.spatial import pseudo_inertia

#: Pseudo-inertia (16, 10) as a linear map of a link's parameters.
AS_MATRIX = np.column_stack([pseudo_inertia(one).ravel() for one in np.eye(10)])


def body(mass, com, inertia):
    """Ten parameters of a body with an inertia about its centre of mass."""
    skew = np.cross(np.eye(3), com)
    about = np.diag(inertia) - mass * skew @ skew
    return np.array([mass, *(mass * np.array(com)), *about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])


def project(parameters):
    """Parameters of the nearest positive semi-definite pseudo-inertia, by its eigenvalues (Higham 1988)."""
    values, vectors = np.linalg.eigh(pseudo_inertia(parameters))
    clipped = vectors @ np.diag(np.maximum(values, 0.0)) @ vectors.T
    return np.linalg.lstsq(AS_MATRIX, clipped.ravel(), rcond=None)[0]


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_projection_where_the_loss_is_the_distance_of_pseudo_inertias(seed):
    rng = np.random.default_rng(seed)
    start = np.concatenate(
        [body(2.0, [0.1, 0.0, 0.2], [0.04, 0.05, 0.03]), body(1.0, [0.0, 0.1, 0.1], [0.03] * 3)]
    )
    free = start + 0.1 * rng.standard_normal(20)
    free[10] = -0.2
    hessian = np.kron(np.eye(2), AS_MATRIX.T @ AS_MATRIX)
    found = nearest_consistent(free, start, hessian)
    right = np.concatenate([project(free[:10]), project(free[10:])])
    assert found == pytest.approx(right, abs=2e-4)
    assert not is_consistent(free)
    assert is_consistent(found + 1e-9 * start)


def test_a_consistent_estimate_stays():
    free = body(2.0, [0.1, 0.0, 0.2], [0.04, 0.05, 0.03])
    assert np.array_equal(nearest_consistent(free, 0.5 * free, np.eye(10)), free)
