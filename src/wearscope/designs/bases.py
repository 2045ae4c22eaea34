"""Structures (2), (3) and (19) of quadratic surrogates as lists of terms, and their regression matrices."""

import re
from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wearscope.designs.factors import FAULT
from wearscope.errors import InputError

MODELS = ("main", "full", "simplified")
_POWER = re.compile(r"([A-Za-z_]\w*)(?:\^([1-9]))?")


def model_terms(model: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return the terms of a model structure.

    Parameters
    ----------
    model : {"main", "full", "simplified"}
        Main effects (2); full second order (3); or second order without interactions and square of the
        fault (19).
    names : sequence of str, (n,)
        Factor names, including the fault ``f``.

    Returns
    -------
    tuple of str
        ``"1"``, the factors, the interactions such as ``"f:w1"``, the squares such as ``"w3^2"``, in that
        order.

    Raises
    ------
    InputError
        Where there is no such model.
    """
    if model not in MODELS:
        raise InputError(f"models: there is no '{model}'; choose among {', '.join(MODELS)}.")
    second = {"main": (), "simplified": [name for name in names if name != FAULT], "full": names}[model]
    interactions = (f"{a}:{b}" for a, b in combinations(second, 2))
    return ("1", *names, *interactions, *(f"{name}^2" for name in second))


def term_exponents(terms: Sequence[str], names: Sequence[str]) -> NDArray[np.int64]:
    """Return the exponent of each factor in each term, (p, n).

    Raises
    ------
    InputError
        Where a term names an unknown factor or cannot be read.
    """
    index = {name: k for k, name in enumerate(names)}
    exponents = np.zeros((len(terms), len(names)), dtype=np.int64)
    for row, term in enumerate(terms):
        if term == "1":
            continue
        for part in term.split(":"):
            match = _POWER.fullmatch(part)
            if match is None or match[1] not in index:
                raise InputError(
                    f"term '{term}': '{part}' is no factor of {', '.join(names)}; write f:w1 or w3^2."
                )
            exponents[row, index[match[1]]] += int(match[2] or 1)
    return exponents


def linear_names(terms: Sequence[str]) -> tuple[str, ...]:
    """Return the factor names of a model, in the order of its linear terms."""
    return tuple(term for term in terms if term != "1" and ":" not in term and "^" not in term)


def model_matrix(z: ArrayLike, names: Sequence[str], terms: Sequence[str]) -> NDArray[np.float64]:
    """Return the regressors Phi(Z) of eqs. (1) and (5).

    Parameters
    ----------
    z : array (N, n)
        Coded levels.
    names : sequence of str, (n,)
    terms : sequence of str, (p,)

    Returns
    -------
    array (N, p)
    """
    z = np.atleast_2d(np.asarray(z, dtype=float))
    exponents = term_exponents(terms, names)
    columns = np.ones((z.shape[0], len(terms)))
    for row, powers in enumerate(exponents):
        for k in np.flatnonzero(powers):
            columns[:, row] *= z[:, k] ** powers[k]
    return columns
