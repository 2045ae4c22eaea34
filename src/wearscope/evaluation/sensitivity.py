"""Sensitivity of test quantities to factors (Q-1): normalised coefficients (8), grouped (9)."""

from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd

from wearscope.errors import InputError
from wearscope.evaluation.grouping import box_statistics, check_group, groups_of, wilson_interval
from wearscope.surrogates.fitting import CELL


def drop_idle(table: pd.DataFrame, screening: pd.DataFrame, column: str) -> pd.DataFrame:
    """Remove each robot's rows about factors that the screening dropped for that robot.

    Parameters
    ----------
    table : DataFrame
        With ``robot`` and `column`.
    screening : DataFrame
        ``robot``, ``factor``, ``dropped``.
    column : str
        Column that holds a factor, or a term of factors (``w3``, ``f:w3``, ``w3^2``).
    """
    dropped = {(row.robot, row.factor) for row in screening[screening["dropped"]].itertuples()}
    if not dropped:
        return table
    kept = [
        not any((robot, part.partition("^")[0]) in dropped for part in term.split(":"))
        for robot, term in zip(table["robot"], table[column].astype(str), strict=True)
    ]
    return table[kept].reset_index(drop=True)


def group_matrices(
    surrogates: pd.DataFrame, model: str = "simplified", by: Sequence[str] = ("fda",)
) -> dict[tuple, pd.DataFrame]:
    """Return the matrices B^k of normalised coefficients, eq. (9).

    Parameters
    ----------
    surrogates : DataFrame
        From `wearscope.surrogates.fitting.fit_surrogates`.
    model : str
    by : sequence of str
        Any subset of ``robot``, ``cycle``, ``axis``, ``fda``; empty for one group of all.

    Returns
    -------
    dict
        Frame (N_k, n_theta - 1) by group key. It has one row for each cell, with the other design parameters
        as index, and one column for each term but the constant. A row is NaN where the fault has no direct
        effect.

    Raises
    ------
    InputError
        Where the table has no such model, or `by` names something else.
    """
    by = check_group(by)
    rows = surrogates[(surrogates["model"] == model) & (surrogates["term"] != "1")]
    if rows.empty:
        known = ", ".join(sorted(set(surrogates["model"])))
        raise InputError(f"surrogates: the table has no model '{model}'; it has {known}.")
    terms = list(dict.fromkeys(rows["term"]))
    index = [name for name in CELL if name not in by] or CELL
    return {
        key: group.pivot(index=index, columns="term", values="theta_normalised").reindex(columns=terms)
        for key, group in groups_of(rows, by)
    }


def sensitivity_of(
    parts: Iterable[pd.DataFrame],
    model: str = "simplified",
    by: Sequence[str] = ("fda",),
) -> pd.DataFrame:
    """Compute box-plot statistics of every term in every group (Fig. 2), and how often a term outweighs f.

    Parameters
    ----------
    parts : iterable of DataFrame
        Parts of the table from `wearscope.surrogates.fitting.fit_surrogates`, each with other cells. Only
        their normalised coefficients stay in memory.
    model : str
    by : sequence of str

    Returns
    -------
    DataFrame
        ``model``, the group columns, ``term``, the columns of `wearscope.evaluation.grouping.box_statistics`,
        ``n_relevant``, ``share_relevant``, ``share_low``, ``share_high`` (number and share of the cells whose
        coefficient lies outside -1..1, with the 95 % Wilson interval of the share), ``median_absolute``.
    """
    terms: dict[str, None] = {}
    columns: dict[tuple, list[dict[str, np.ndarray]]] = {}
    for part in parts:
        for key, matrix in group_matrices(part, model, by).items():
            terms |= dict.fromkeys(matrix.columns)
            columns.setdefault(key, []).append(
                {term: matrix[term].to_numpy(dtype=float) for term in matrix.columns}
            )
    records = []
    for key in sorted(columns):
        for term in terms:
            # A term that was dropped for the robots of a part is NaN there, not zero.
            values = np.concatenate(
                [one.get(term, np.full(len(next(iter(one.values()))), np.nan)) for one in columns[key]]
            )
            good = values[np.isfinite(values)]
            relevant = int(np.sum(np.abs(good) > 1.0))
            low, high = wilson_interval(relevant, good.size)
            records.append(
                {
                    "model": model,
                    **dict(zip(by, key, strict=True)),
                    "term": term,
                    **box_statistics(values),
                    "n_relevant": relevant,
                    "share_relevant": relevant / good.size if good.size else np.nan,
                    "share_low": low,
                    "share_high": high,
                    "median_absolute": float(np.median(np.abs(good))) if good.size else np.nan,
                }
            )
    return pd.DataFrame(records)
