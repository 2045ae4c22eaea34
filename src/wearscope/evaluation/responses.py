"""What a surrogate says of the test quantity over one factor at a time, with the runs that it rests on."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd

from wearscope.designs.factors import CODED_HIGH, CODED_LOW, Factor
from wearscope.surrogates.fitting import CELL
from wearscope.surrogates.selection import ChosenSurrogate
from wearscope.surrogates.surrogate import Surrogate

STEPS = 33

#: A surrogate by its cell (robot, cycle, axis, fda).
Cells = Iterable[tuple[tuple, ChosenSurrogate | Surrogate]]


def response_table(
    cells: Cells,
    factors: Sequence[Factor],
    levels: Mapping[str, float],
    steps: int = STEPS,
) -> pd.DataFrame:
    """Response of every cell along each factor, the others held.

    Parameters
    ----------
    cells : iterable of (key, surrogate)
    factors : sequence of Factor
    levels : mapping
        Coded levels at which the others are held.
    steps : int
        Levels a factor, evenly over its simulated range.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``factor``, ``coded``, ``natural``, ``y``, and ``low``,
        ``high``, which hold the value of a new run with a probability of 95 % (NaN without residual degrees
        of freedom).
    """
    line = np.linspace(CODED_LOW, CODED_HIGH, steps)
    parts = []
    for key, surrogate in cells:
        for factor in factors:
            z = np.tile([levels[name] for name in surrogate.names], (steps, 1)).astype(float)
            z[:, surrogate.names.index(factor.name)] = line
            low, high = surrogate.prediction_interval(z)
            columns = {"coded": line, "natural": factor.to_natural(line), "y": surrogate.predict(z)}
            parts.append(((*key[:4], factor.name), columns | {"low": low, "high": high}))
    return _join(parts)


def simulated_table(
    cells: Cells, test_quantities: pd.DataFrame, factors: Sequence[Factor], levels: Mapping[str, float]
) -> pd.DataFrame:
    """Simulated runs of every cell along each factor, with and without the influence of other factors.

    Parameters
    ----------
    cells : iterable of (key, surrogate)
    test_quantities : DataFrame
    factors : sequence of Factor
    levels : mapping
        Coded levels of the other factors after their influence is removed.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``factor``, ``set``, ``point``, ``natural``, ``y``,
        ``y_held``: y less what the surrogate gives to the other factors' distance from `levels`. Failed runs
        are left out.
    """
    runs = dict(iter(test_quantities.dropna(subset=["y"]).groupby(CELL, sort=True, observed=True)))
    parts = []
    for key, surrogate in cells:
        if key not in runs:
            continue
        own = runs[key].sort_values(["set", "point"])
        z = own[list(surrogate.names)].to_numpy(dtype=float)
        y = own["y"].to_numpy(dtype=float)
        left = y - surrogate.predict(z)
        for factor in factors:
            k = surrogate.names.index(factor.name)
            held = np.tile([levels[name] for name in surrogate.names], (len(z), 1)).astype(float)
            held[:, k] = z[:, k]
            columns = {
                "set": own["set"].to_numpy(),
                "point": own["point"].to_numpy(),
                "natural": factor.to_natural(z[:, k]),
                "y": y,
                "y_held": surrogate.predict(held) + left,
            }
            parts.append(((*key[:4], factor.name), columns))
    return _join(parts)


def _join(parts: Sequence[tuple[Sequence[object], Mapping[str, np.ndarray]]]) -> pd.DataFrame:
    """One table of parts, each with its cell and factor, column by column: a frame a part takes seconds."""
    keys = pd.DataFrame([key for key, _ in parts], columns=[*CELL, "factor"])
    counts = [len(next(iter(columns.values()))) for _, columns in parts]
    table = keys.loc[keys.index.repeat(counts)].reset_index(drop=True)
    for name in parts[0][1]:
        table[name] = np.concatenate([columns[name] for _, columns in parts])
    return table
