"""The SNR of each detector by its source: surrogates, direct simulation, a robot unlike its model."""

import numpy as np
import pandas as pd

from wearscope.surrogates.fitting import CELL


def snr_sources(
    answer: pd.DataFrame,
    paper: pd.DataFrame | None = None,
    direct: pd.DataFrame | None = None,
    mismatch: pd.DataFrame | None = None,
) -> pd.DataFrame:
    """A row a detector; a column is left out where its source is.

    Parameters
    ----------
    answer : DataFrame
        SNR of the surrogate that answers.
    paper : DataFrame, optional
        SNR of the paper's model (3).
    direct, mismatch : DataFrame, optional
        From `wearscope.evaluation.direct`, of one cell a detector.

    Returns
    -------
    DataFrame
        ``fda``; ``median`` over the cells, ``median_paper``; of the cell that was simulated directly:
        ``surrogate``, ``direct``, ``mismatch``, and ``answer``: the direct value where the two disagree.
    """
    table = answer.groupby("fda", sort=True)["snr_exact"].median().rename("median").reset_index()
    if paper is not None:
        medians = paper.groupby("fda")["snr_exact"].median().rename("median_paper")
        table = table.merge(medians, on="fda", how="left")
    if direct is None or direct.empty:
        return table
    cell = direct[["fda"]].assign(surrogate=direct["snr_surrogate"], direct=direct["snr_direct"])
    disagree = direct["agrees"].map(lambda one: one is not None and one == 0).to_numpy(dtype=bool)
    cell["answer"] = np.where(disagree, direct["snr_direct"], direct["snr_surrogate"])
    if mismatch is not None and len(mismatch):
        here = direct[CELL].merge(mismatch, on=CELL, how="left")
        cell["mismatch"] = here["snr_mismatch"].to_numpy()
    return table.merge(cell, on="fda", how="left")
