"""The same simulated points as the detector of each axis sees them."""

from collections.abc import Sequence

import pandas as pd

from wearscope.designs.factors import PAPER_FACTORS, Factor, wear_names
from wearscope.errors import InputError


def view_for_axis(design: pd.DataFrame, axis: int, factors: Sequence[Factor] = PAPER_FACTORS) -> pd.DataFrame:
    """Permute the wear columns of a design to one axis's point of view.

    In a simulated point the k-th wear factor (``f``, ``w1``, ``w2``) is the wear of axis k. The detector of
    axis j sees its own axis's wear as ``f`` and the others' as ``w1``, ``w2``, in axis order. All other
    columns stay.

    Parameters
    ----------
    design : DataFrame
        Coded columns, natural columns or both.
    axis : int
        1, 2, 3.
    factors : sequence of Factor

    Returns
    -------
    DataFrame
        The same rows and columns.

    Raises
    ------
    InputError
        Where the factors give that axis no wear.
    """
    wear = wear_names(factors)
    if not 1 <= axis <= len(wear):
        raise InputError(
            f"axis {axis}: the factors declare the wear of {len(wear)} axes; add a wear factor or drop the "
            "axis."
        )
    seen = [wear[axis - 1], *(name for name in wear if name != wear[axis - 1])]
    view = design.copy()
    for suffix in ("", "_natural"):
        if f"{wear[0]}{suffix}" in design.columns:
            for name, source in zip(wear, seen, strict=True):
                view[f"{name}{suffix}"] = design[f"{source}{suffix}"].to_numpy()
    return view
