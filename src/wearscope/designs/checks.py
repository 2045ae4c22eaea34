"""Checks of a design before it is simulated: which terms it can estimate, and how well."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from wearscope.designs.bases import MODELS, model_matrix, model_terms
from wearscope.designs.factors import (
    PAPER_FACTORS,
    Factor,
    nominal_levels,
    wear_by_axis,
    wear_names,
    worn_factor,
)
from wearscope.errors import InputError


def view_for_axis(design: pd.DataFrame, axis: int, factors: Sequence[Factor] = PAPER_FACTORS) -> pd.DataFrame:
    """Permute the wear columns of a design, so that ``f`` is the wear of one axis.

    In a simulated point each wear factor (``f``, ``w1``, ``w2``) is the wear of one axis. For the detector of
    an axis, ``f`` is the wear of its own axis, and ``w1``, ``w2`` are those of the other axes in their order.
    All other columns stay as they are.

    Parameters
    ----------
    design : DataFrame
        Design with coded columns, natural columns or both.
    axis : int
        An axis that `wearscope.designs.factors.wear_by_axis` returns.
    factors : sequence of Factor

    Returns
    -------
    DataFrame
        The same rows and columns.

    Raises
    ------
    InputError
        Where no factor is the wear of this axis.
    """
    wear = wear_names(factors)
    if not wear:  # the fault is the same for every axis
        return design.copy()
    own = worn_factor(factors, axis)
    seen = [own, *(name for name in wear if name != own)]
    view = design.copy()
    for suffix in ("", "_natural"):
        if f"{wear[0]}{suffix}" in design.columns:
            for name, source in zip(wear, seen, strict=True):
                view[f"{name}{suffix}"] = design[f"{source}{suffix}"].to_numpy()
    return view


Array = NDArray[np.float64]
_TOLERANCE = 1e-8


def coded_names(design: pd.DataFrame) -> list[str]:
    """Return the coded factor columns of a design: those that have a column of natural levels."""
    return [name for name in design.columns if name != "point" and f"{name}_natural" in design.columns]


def cube_rows(z: ArrayLike) -> Array:
    """Return the rows (N_c, n) of a coded matrix that are corners of a two-level cube, scaled to +-1."""
    z = np.asarray(z, dtype=float)
    size = np.abs(z)
    corners = z[(size.max(axis=1) > 0) & (size.max(axis=1) - size.min(axis=1) < 1e-9)]
    if len(corners) == 0:
        return np.zeros((0, z.shape[1]))
    size = np.abs(corners[:, 0])
    return np.sign(corners[np.abs(size - size.max()) < 1e-9])


def defining_relation(z: ArrayLike, names: Sequence[str]) -> list[tuple[int, tuple[str, ...]]]:
    """Return the defining relation of a design's cube: the products of factors that are constant.

    Parameters
    ----------
    z : array (N, n)
        Coded levels.
    names : sequence of str, (n,)

    Returns
    -------
    list of (sign, factors)
        Sign and factors of each product, the shortest first; empty for a full factorial or without a cube.
    """
    cube = cube_rows(z)
    words: list[tuple[int, tuple[str, ...]]] = []
    if len(cube) == 0:
        return words
    for length in range(1, len(names) + 1):
        for group in combinations(range(len(names)), length):
            product = np.prod(cube[:, group], axis=1)
            if np.all(product == product[0]):
                words.append((int(product[0]), tuple(names[k] for k in group)))
    return words


def resolution(z: ArrayLike, names: Sequence[str]) -> int | None:
    """Return the length of the shortest product in the defining relation; None where there is none."""
    words = defining_relation(z, names)
    return len(words[0][1]) if words else None


def term_dependencies(phi: ArrayLike, terms: Sequence[str]) -> dict[str, dict[str, float]]:
    """Find the terms whose column is a linear combination of earlier columns.

    Parameters
    ----------
    phi : array (N, p)
    terms : sequence of str, (p,)

    Returns
    -------
    dict
        The combination by term: ``{"w1:w2": {"f": 1.0}}`` means that w1:w2 cannot be told apart from f. It is
        empty where phi has full rank.
    """
    phi = np.asarray(phi, dtype=float)
    scale = np.linalg.norm(phi, axis=0)
    kept: list[int] = []
    result: dict[str, dict[str, float]] = {}
    for k, term in enumerate(terms):
        if scale[k] == 0:
            result[term] = {}
            continue
        if kept:
            basis = phi[:, kept] / scale[kept]
            weights = np.linalg.lstsq(basis, phi[:, k], rcond=None)[0]
            if np.linalg.norm(phi[:, k] - basis @ weights) <= _TOLERANCE * scale[k]:
                weights = weights / scale[kept]
                result[term] = {
                    terms[j]: float(np.round(w, 10))
                    for j, w in zip(kept, weights, strict=True)
                    if abs(w) > _TOLERANCE
                }
                continue
        kept.append(k)
    return result


def prediction_variance(z: ArrayLike, names: Sequence[str], model: str, at: ArrayLike) -> NDArray[np.float64]:
    """Return the variance of the predicted mean over that of a run, phi(z)' (Phi'Phi)^-1 phi(z).

    Parameters
    ----------
    z : array (N, n)
        Coded design.
    names : sequence of str, (n,)
    model : str
    at : array (M, n)
        Coded points of the prediction; at the design's own points the result is their leverage.

    Returns
    -------
    array (M,)
    """
    terms = model_terms(model, names)
    _, r = np.linalg.qr(model_matrix(z, names, terms))
    half = np.linalg.solve(r.T, model_matrix(at, names, terms).T)
    return np.sum(half * half, axis=0)


def check_estimable(
    design: pd.DataFrame, model: str, names: Sequence[str] | None = None, axis: int | None = None
) -> None:
    """Refuse a design that does not determine a model's coefficients.

    Parameters
    ----------
    design : DataFrame
        Coded design as `view_for_axis` returns it.
    model : {"main", "full", "simplified"}
    names : sequence of str, optional
        Factor columns; by default those that `coded_names` finds.
    axis : int, optional
        Axis to name in the message.

    Raises
    ------
    InputError
        Where terms are aliased; the sentence names them and the remedy.
    """
    names = list(names or coded_names(design))
    terms = model_terms(model, names)
    where = f"design of {len(design)} points" + (f", seen from axis {axis}" if axis else "")
    phi = model_matrix(design[names].to_numpy(dtype=float), names, terms)
    bad = term_dependencies(phi, terms)
    if not bad:
        return
    shown = [f"{term} with {_name_some(list(others))}" for term, others in list(bad.items())[:4]]
    more = f" and {len(bad) - len(shown)} more" if len(bad) > len(shown) else ""
    if len(design) < len(terms):
        more += f", and {len(design)} points cannot carry {len(terms)} terms"
    needs = {
        "main": "vary every factor, by itself, over at least two levels",
        "simplified": "use a central composite with generators of resolution V or more, or model 'main'",
        "full": "use a central composite with generators of resolution V or more, or a smaller model",
    }
    raise InputError(
        f"{where}: model '{model}' has {len(terms)} terms but only {len(terms) - len(bad)} can be estimated, "
        f"because these are aliased: {'; '.join(shown)}{more}; {needs[model]}."
    )


def _name_some(terms: Sequence[str]) -> str:
    """Name the first three terms and the number of the others."""
    if not terms:
        return "nothing (it is always 0)"
    rest = f" and {len(terms) - 3} more" if len(terms) > 3 else ""
    return " and ".join(terms[:3]) + rest


def check_design(
    design: pd.DataFrame, factors: Sequence[Factor], models: Sequence[str] = MODELS, axes: Sequence[int] = ()
) -> None:
    """Refuse a design that does not determine the coefficients of every model for every axis.

    Parameters
    ----------
    design : DataFrame
    factors : sequence of Factor
    models : sequence of str
    axes : sequence of int
        By default every axis that has a wear factor.

    Raises
    ------
    InputError
        See `check_estimable`.
    """
    names = [factor.name for factor in factors]
    for axis in axes or wear_by_axis(factors):
        view = view_for_axis(design, axis, factors)
        for model in models:
            check_estimable(view, model, names, axis)


def describe_design(
    design: pd.DataFrame, factors: Sequence[Factor], models: Sequence[str] = MODELS
) -> pd.DataFrame:
    """Describe a design by the checks of each model, one row for each.

    Returns
    -------
    DataFrame
        ``model``, ``points``, ``terms``, ``rank``, ``condition``, ``dof``, ``resolution`` (0 without a
        defining relation), ``defining_relation``, ``leverage_max``, ``variance_centre`` and
        ``variance_nominal`` (prediction variance over that of a run, at the centre and at z0, eq. (18)),
        ``nominal_norm`` (norm of z0), ``region_norm`` (largest norm of a point at which no factor is 0, such
        as the corners of a composite; else of any point) and ``nominal_outside`` (whether the former exceeds
        the latter).
    """
    names = [factor.name for factor in factors]
    z = design[names].to_numpy(dtype=float)
    z0 = np.array([[nominal_levels(factors)[name] for name in names]])
    words = defining_relation(z, names)
    corners = np.abs(z).min(axis=1) > 0
    region = float(np.linalg.norm(z[corners] if corners.any() else z, axis=1).max())
    records = []
    for model in models:
        terms = model_terms(model, names)
        phi = model_matrix(z, names, terms)
        rank = int(np.linalg.matrix_rank(phi))
        whole = rank == len(terms)
        at = np.vstack([np.zeros_like(z0), z0, z])
        variance = prediction_variance(z, names, model, at) if whole else np.full(len(at), np.nan)
        records.append(
            {
                "model": model,
                "points": len(z),
                "terms": len(terms),
                "rank": rank,
                "condition": float(np.linalg.cond(phi)) if whole else np.inf,
                "dof": len(z) - rank,
                "resolution": len(words[0][1]) if words else 0,
                "defining_relation": " = ".join(
                    ["I", *(("-" if sign < 0 else "") + " ".join(word) for sign, word in words)]
                ),
                "leverage_max": float(variance[2:].max()),
                "variance_centre": float(variance[0]),
                "variance_nominal": float(variance[1]),
                "nominal_norm": float(np.linalg.norm(z0)),
                "region_norm": region,
                "nominal_outside": bool(np.linalg.norm(z0) > region + 1e-9),
            }
        )
    return pd.DataFrame(records)
