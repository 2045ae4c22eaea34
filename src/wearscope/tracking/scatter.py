"""How much healthy sessions differ: what a change must exceed beyond its own noise."""

from collections.abc import Sequence

import numpy as np

from wearscope.tracking.evidence import Evidence
from wearscope.tracking.rows import RunRows, scatter_columns
from wearscope.tracking.structure import Structure

#: Prior scatter, as a share of the joint's friction and of its whole torque, and the sessions it is worth.
PRIOR_FRICTION, PRIOR_TORQUE, _PRIOR_SESSIONS = 0.01, 0.003, 3.0
#: What each of `scatter_columns` scatters a priori.
_PRIOR = (PRIOR_FRICTION, PRIOR_FRICTION, PRIOR_FRICTION, PRIOR_TORQUE, PRIOR_TORQUE)


def prior_scatter(structure: Structure) -> np.ndarray:
    """Standard deviation of each of `scatter_columns` before any healthy session is seen."""
    return np.tile(_PRIOR, len(structure.moving))


def measure_scatter(
    structure: Structure, healthy: Sequence[Evidence], made: Sequence[Sequence[RunRows]]
) -> np.ndarray:
    """Standard deviation of each of `scatter_columns` between healthy sessions, each against the others.

    Parameters
    ----------
    structure : Structure
    healthy : sequence of Evidence
        Each session with what the others say of the machine.
    made : sequence of sequence of RunRows
        Rows of each.
    """
    prior = prior_scatter(structure)
    square = np.zeros_like(prior)
    for evidence, rows in zip(healthy, made, strict=True):
        x = np.concatenate([scatter_columns(structure, r) for r in rows])
        left = evidence.fit(()).left * evidence.keep
        for k, j in enumerate(np.repeat(structure.moving, len(_PRIOR))):
            d = x[:, j, k] * evidence.keep[:, j]
            size = max(float(d @ d), 1e-300)
            noise = float(left[:, j] @ left[:, j]) / evidence.count[j] / size
            square[k] += max(
                (float(d @ left[:, j]) / size) ** 2 - noise * evidence.design(d * left[:, j]), 0.0
            )
    return np.asarray(np.sqrt((_PRIOR_SESSIONS * prior**2 + square) / (_PRIOR_SESSIONS + len(healthy))))
