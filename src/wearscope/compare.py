"""How two tables of the same kind differ, in one line."""

import numpy as np
import pandas as pd


def compare_tables(a: pd.DataFrame, b: pd.DataFrame) -> str:
    """Describe the difference of two tables; empty where their values are equal (NaN equals NaN).

    Parameters
    ----------
    a, b : DataFrame
        Rows are compared in their order.

    Returns
    -------
    str
        E.g. ``y: 12 of 90 rows, largest difference 0.3 (0.1 %)``.
    """
    if list(a.columns) != list(b.columns):
        missing = sorted(set(a.columns) ^ set(b.columns))
        return f"columns differ: {', '.join(missing)}" if missing else "columns are in another order"
    if len(a) != len(b):
        return f"{len(a)} rows against {len(b)}"
    return "; ".join(filter(None, (_compare_column(name, a[name], b[name]) for name in a.columns)))


def _compare_column(name: str, a: pd.Series, b: pd.Series) -> str:
    numbers = all(
        pd.api.types.is_numeric_dtype(one) and not pd.api.types.is_bool_dtype(one) for one in (a, b)
    )
    if not numbers:
        different = np.array([_text(x) != _text(y) for x, y in zip(a, b, strict=True)], dtype=bool)
        return f"{name}: {int(different.sum())} of {len(a)} rows" if different.any() else ""
    x, y = a.to_numpy(dtype=float), b.to_numpy(dtype=float)
    same = (x == y) | (np.isnan(x) & np.isnan(y))
    if same.all():
        return ""
    where = f"{name}: {int((~same).sum())} of {len(a)} rows"
    both = ~same & np.isfinite(x) & np.isfinite(y)
    if not both.any():
        return where
    gap = np.abs(x[both] - y[both])
    largest = int(np.argmax(gap))
    scale = max(abs(x[both][largest]), abs(y[both][largest]))
    return f"{where}, largest difference {gap[largest]:.3g} ({100 * gap[largest] / scale:.2g} %)"


def _text(value: object) -> str:
    return np.array2string(value, threshold=1 << 30) if isinstance(value, np.ndarray) else repr(value)
