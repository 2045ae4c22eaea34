"""Residuals over the signals that they may depend on, in bins, as the page draws them."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Array = NDArray[np.float64]
BINS = 24
FEWEST = 5
"""Fewest rows of a bin."""
STAGES = ("before", "after")
CODES = ("q", "qd", "qdd", "load", "temp")
UNITS = {"n": "1"}


def profile_residuals(residual: pd.DataFrame, signals: pd.DataFrame) -> pd.DataFrame:
    """Medians and quartiles of each joint's residual in bins of each signal, on all rows that count.

    Parameters
    ----------
    residual : DataFrame
        As ``residual.parquet``.
    signals : DataFrame
        As ``signals.parquet``, its rows those of `residual`.

    Returns
    -------
    DataFrame
        ``joint``, ``signal`` (``<code>_<joint>``, or ``t`` since the start of the run), ``stage``, ``x``
        (middle of the bin), ``median``, ``low``, ``high`` (quartiles), ``n``.
    """
    joints = list(dict.fromkeys(residual["joint"]))
    own = {joint: residual[residual["joint"] == joint].reset_index(drop=True) for joint in joints}
    seen = {joint: signals[signals["joint"] == joint].reset_index(drop=True) for joint in joints}
    parts = []
    for joint in joints:
        rows = own[joint]
        counts = rows["counts"].to_numpy(dtype=bool)
        axes = {"t": (rows["t"] - rows.groupby("run")["t"].transform("min")).to_numpy(dtype=float)}
        axes |= {
            f"{code}_{other}": seen[other][code].to_numpy(dtype=float) for other in joints for code in CODES
        }
        for name, x in axes.items():
            good = counts & np.isfinite(x)
            for stage in STAGES:
                found = bin_quartiles(x[good], rows[f"residual_{stage}"].to_numpy(dtype=float)[good])
                parts.append(pd.DataFrame({"joint": joint, "signal": name, "stage": stage, **found}))
    return pd.concat(parts, ignore_index=True)


def bin_quartiles(x: Array, y: Array) -> dict[str, Array]:
    """``x`` (middle), ``median``, ``low``, ``high`` and ``n`` of `y` in bins of equal width of `x`.

    Bins span all but the outermost 0.2 % of `x` at either end; those with fewer than `FEWEST` values are left
    out.
    """
    names = ("x", "median", "low", "high", "n")
    good = np.isfinite(y)
    x, y = x[good], y[good]
    if len(x) < FEWEST:
        return {name: np.zeros(0) for name in names}
    low, high = np.quantile(x, [0.002, 0.998])
    if not high > low:
        middle = (np.median(x), *np.quantile(y, [0.5, 0.25, 0.75]), len(x))
        return {name: np.array([value]) for name, value in zip(names, middle, strict=True)}
    edges = np.linspace(low, high, BINS + 1)
    place = np.digitize(x, edges) - 1
    rows = []
    for k in range(BINS):
        inside = y[place == k]
        if len(inside) >= FEWEST:
            middle = 0.5 * (edges[k] + edges[k + 1])
            rows.append((middle, *np.quantile(inside, [0.5, 0.25, 0.75]), len(inside)))
    columns = np.array(rows).reshape(-1, len(names)).T
    return dict(zip(names, columns, strict=True))
