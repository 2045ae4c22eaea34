"""The same simulated points as the detector of each axis sees them."""

from collections.abc import Sequence

import pandas as pd

from wearscope.designs.factors import PAPER_FACTORS, Factor, wear_names, worn_factor


def view_for_axis(design: pd.DataFrame, axis: int, factors: Sequence[Factor] = PAPER_FACTORS) -> pd.DataFrame:
    """Permute the wear columns of a design to one axis's point of view.

    In a simulated point each wear factor (``f``, ``w1``, ``w2``) is the wear of an axis. The detector of an
    axis sees its own axis's wear as ``f`` and the others' as ``w1``, ``w2``, in axis order. All other columns
    stay.

    Parameters
    ----------
    design : DataFrame
        Coded columns, natural columns or both.
    axis : int
        One of `wearscope.designs.factors.wear_by_axis`.
    factors : sequence of Factor

    Returns
    -------
    DataFrame
        The same rows and columns.

    Raises
    ------
    InputError
        Where the factors give wear to other axes only.
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
