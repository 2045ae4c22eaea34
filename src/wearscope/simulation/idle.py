"""Factors that move no torque, left out of tables; apart from what finds them, which simulates."""

import pandas as pd


def drop_idle(table: pd.DataFrame, screening: pd.DataFrame, column: str) -> pd.DataFrame:
    """Rows of a table by robot without those about factors that were dropped there.

    Parameters
    ----------
    table : DataFrame
        With ``robot`` and `column`.
    screening : DataFrame
        ``robot``, ``factor``, ``dropped``.
    column : str
        Holds a factor, or a term of factors (``w3``, ``f:w3``, ``w3^2``).
    """
    dropped = {(row.robot, row.factor) for row in screening[screening["dropped"]].itertuples()}
    if not dropped:
        return table
    kept = [
        not any((robot, part.partition("^")[0]) in dropped for part in term.split(":"))
        for robot, term in zip(table["robot"], table[column].astype(str), strict=True)
    ]
    return table[kept].reset_index(drop=True)
