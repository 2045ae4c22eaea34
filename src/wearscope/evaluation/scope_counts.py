"""How many cells pass on the grid of the scope matrices: counts, which add over parts of a study."""

from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from wearscope.evaluation.grouping import check_group
from wearscope.surrogates.fitting import CELL

#: Share of the draws of a surrogate for which a grid cell must pass to count as sure.
SURE = 0.95
COUNTS = ("cells", "passes", "known", "sure", "differ")
Matrix = NDArray[np.float64]
_GRID = ["factor", "method", "delta", "sigma"]


def count_scope(scope: pd.DataFrame, by: Sequence[str] = ("fda",)) -> pd.DataFrame:
    """Counts of the cells of each group at each point of the grid.

    Parameters
    ----------
    scope : DataFrame
        From `wearscope.evaluation.scope.scope_table`; ``confidence`` may be missing.
    by : sequence of str
        Any subset of ``robot``, ``cycle``, ``axis``, ``fda``.

    Returns
    -------
    DataFrame
        The group columns, ``factor``, ``method``, ``delta``, ``sigma``, sorted, then numbers of ``cells``, of
        those that pass (``passes``), whose confidence is known (``known``) and at least `SURE` (``sure``),
        and, on the rows of the exact method, whose verdict by the other method differs (``differ``).
    """
    differ = np.zeros(len(scope), dtype=np.int64)
    rows = scope
    if 2 * (scope["method"] == "exact").sum() == len(scope):
        rows = scope.sort_values([*CELL, *_GRID], kind="stable")
        exact, passes = (rows["method"] == "exact").to_numpy(), rows["passes"].to_numpy(dtype=bool)
        differ[exact] = passes[exact] != passes[~exact]
    confidence = rows["confidence"] if "confidence" in rows else pd.Series(np.nan, index=rows.index)
    marked = rows[[*check_group(by), *_GRID]].assign(
        cells=1,
        passes=rows["passes"].to_numpy(dtype=np.int64),
        known=confidence.notna().to_numpy(dtype=np.int64),
        sure=(confidence >= SURE).to_numpy(dtype=np.int64),
        differ=differ,
    )
    return _add(marked)


def add_counts(parts: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Counts of all parts together, each of other cells; one part and the sum are held at a time."""
    total: pd.DataFrame | None = None
    for part in parts:
        total = part if total is None else _add(pd.concat([total, part], ignore_index=True))
    if total is None:
        raise ValueError("no part to count")
    return total


def count_matrix(rows: pd.DataFrame, passing: object) -> tuple[Matrix, Matrix, Matrix]:
    """Number of passing cells on the grid.

    Parameters
    ----------
    rows : DataFrame
        One method's rows, of cells or of counts.
    passing : array (N,)
        Whether a row's cell passes, or how many of its cells do.

    Returns
    -------
    sigma (S,), delta (J,), count (J, S)
    """
    table = rows[["delta", "sigma"]].assign(count=np.asarray(passing, dtype=float))
    wide = table.pivot_table(index="delta", columns="sigma", values="count", aggfunc="sum")
    return wide.columns.to_numpy(float), wide.index.to_numpy(float), wide.to_numpy(float)


def _add(table: pd.DataFrame) -> pd.DataFrame:
    keys = [name for name in table.columns if name not in COUNTS]
    return table.groupby(keys, sort=True, observed=True)[list(COUNTS)].sum().reset_index()
