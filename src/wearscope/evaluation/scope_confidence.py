"""How sure a scope verdict is, given the uncertainty of the surrogate's coefficients."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wearscope.designs.factors import FAULT
from wearscope.evaluation.scope_exact import detection_probability, standardise
from wearscope.surrogates.surrogate import Surrogate, expand_coefficients

Array = NDArray[np.float64]


def along_operator(
    surrogate: Surrogate, factor: str, levels: Mapping[str, float], faults: ArrayLike
) -> Array:
    """Matrices (J, p, 3) that turn coefficients into a, b, c of `Surrogate.along` at fault levels (J,)."""
    names = surrogate.names
    k = names.index(factor)
    held = {**levels, FAULT: 0.0, factor: 0.0}
    z = np.tile([held[name] for name in names], (np.size(faults), 1))
    z[:, names.index(FAULT)] = faults
    constant, linear, q = expand_coefficients(np.eye(len(surrogate.terms)), surrogate.terms, names)
    level = constant + z @ linear.T + ((z @ q) * z).sum(axis=-1).T
    slope = linear[:, k] + 2 * z @ q[:, k].T
    return np.stack([level, slope, np.broadcast_to(q[:, k, k], slope.shape)], axis=-1)


def pass_confidence(
    surrogate: Surrogate,
    factor: str,
    deltas: Array,
    sigmas: Array,
    levels: Mapping[str, float],
    rng: np.random.Generator,
    draws: int = 200,
    f0: float = -2.0,
    false_alarm: float = 0.01,
    detection: float = 0.99,
) -> Array:
    """Share of coefficient draws for which a grid cell meets (12), by the exact method.

    Parameters
    ----------
    surrogate : Surrogate
    factor : str
        The nuisance that varies.
    deltas, sigmas : array (J,), (S,)
    levels : mapping
        Coded levels of the other nuisances.
    rng : numpy.random.Generator
    draws : int
        Coefficient vectors, see `Surrogate.draw_coefficients`; the share has a standard error of at most
        0.5 / sqrt(draws).
    f0, false_alarm, detection : float
        As in `wearscope.evaluation.scope.scope_table`.

    Returns
    -------
    array (S, J)
        0 for a constant detector; NaN without residual degrees of freedom or draws.
    """
    shape = (len(sigmas), len(deltas))
    if surrogate.status == "constant":
        return np.zeros(shape)
    if surrogate.dof < 1 or draws < 1:
        return np.full(shape, np.nan)
    theta = surrogate.draw_coefficients(rng, draws)
    maps = along_operator(surrogate, factor, levels, f0 + np.concatenate([[0.0], deltas]))
    along = np.einsum("dp,jpc->jdc", theta, maps)
    null = standardise(along[0], sigmas[:, None])
    worn = standardise(along[1:], sigmas[:, None, None])
    p_d = detection_probability(null[:, None], worn, false_alarm)
    return np.mean(p_d >= detection, axis=-1)
