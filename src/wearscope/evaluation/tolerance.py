"""Scope in one number: how much a nuisance may vary until a change of the fault is no longer detected."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from wearscope.evaluation.sampled_scope import Tabulated, tabulated_scope
from wearscope.surrogates.selection import ChosenSurrogate

Array = NDArray[np.float64]


def largest_passing(passes: NDArray[np.bool_], sigmas: Array) -> Array:
    """Largest sigma up to which all sigmas pass, shape (...) from passes (..., S); 0 if the first fails."""
    reached = np.where(passes.all(axis=-1), passes.shape[-1], np.argmin(passes, axis=-1))
    return np.concatenate([[0.0], sigmas])[reached]


def sampled_tolerance(
    surrogate: ChosenSurrogate,
    factor: str,
    levels: Mapping[str, float],
    deltas: Array,
    sigmas: Array,
    rng: np.random.Generator,
    draws: int,
    f0: float = -2.0,
    false_alarm: float = 0.01,
    detection: float = 0.99,
) -> tuple[Array, Array]:
    """Largest standard deviation of a nuisance that a cell bears, coded.

    Parameters
    ----------
    surrogate : ChosenSurrogate
    factor : str
        The nuisance that varies about its nominal level; the others are held.
    levels : mapping
        Coded nominal levels.
    deltas, sigmas : array (J,), (S,)
    rng : numpy.random.Generator
    draws : int
        Response functions.
    f0, false_alarm, detection : float
        As in `wearscope.evaluation.scope.scope_table`.

    Returns
    -------
    value : array (J,)
        Of the mean response; at most the last sigma.
    drawn : array (draws, J)
    """
    if surrogate.status == "constant":
        return np.zeros(len(deltas)), np.zeros((draws, len(deltas)))
    table = Tabulated(surrogate, factor, levels, deltas, f0)
    value = tabulated_scope(table.mean, table.nodes, sigmas, false_alarm, table.centre) >= detection
    passes = table.drawn_passes(sigmas, rng, draws, false_alarm, detection)
    return largest_passing(value.T, sigmas), largest_passing(np.swapaxes(passes, 1, 2), sigmas)
