"""The chosen surrogate of every cell as a table: kind, fit, noise ceiling, points, state."""

import json
from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd
from scipy import special

from wearscope.designs.factors import Factor, nominal_levels
from wearscope.errors import InputError
from wearscope.surrogates.fitting import (
    CELL,
    IDENTIFICATION,
    VALIDATION,
    cell_name,
    cells_of,
    factor_columns,
    surrogates_of,
    usable_points,
)
from wearscope.surrogates.kinds.base import model_fit, pure_error
from wearscope.surrogates.selection import CHOSEN, KINDS, ChosenSurrogate, choose_surrogate, rebuild_surrogate
from wearscope.surrogates.surrogate import Surrogate

FILLING = "filling"
CHECKING = "checking"
#: Sets whose runs a chosen surrogate learns from; no fit and no choice sees the runs of `CHECKING`.
TRAINING = (IDENTIFICATION, VALIDATION, FILLING)


def training_runs(
    cell: pd.DataFrame, names: Sequence[str], max_failed_share: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Coded levels (N, n) and values (N,) that a cell's surrogate learns from, by set and point."""
    rows = cell[cell["set"].isin(TRAINING)].sort_values(["set", "point"])
    key = tuple(rows[CELL].iloc[0]) if len(rows) else ()
    good = usable_points(rows, key, max_failed_share)
    return good[list(names)].to_numpy(dtype=float), good["y"].to_numpy(dtype=float)


def noise_ceiling(y: np.ndarray, squares: float, freedom: int) -> tuple[float, float]:
    """Fit (6) [%] that noise alone leaves at values y, and the lowest that its uncertainty allows (95 %).

    Parameters
    ----------
    y : array (M,)
        Runs that a fit is stated on.
    squares, freedom : float, int
        Of the noise, from replicated runs.

    Returns
    -------
    ceiling, low : float
        NaN without replicates or where y does not vary.
    """
    if freedom < 1 or len(y) < 2 or np.ptp(y) == 0:
        return np.nan, np.nan
    deviation = float(np.sqrt(np.mean((y - y.mean()) ** 2)))
    largest = squares / special.chdtri(freedom, 0.95)
    return (
        100.0 * (1.0 - float(np.sqrt(squares / freedom)) / deviation),
        100.0 * (1.0 - float(np.sqrt(largest)) / deviation),
    )


def choose_surrogates(
    test_quantities: pd.DataFrame,
    factors: Sequence[Factor],
    kinds: Sequence[str] = KINDS,
    goal: float = 95.0,
    max_failed_share: float = 0.05,
) -> pd.DataFrame:
    """Choose a surrogate for every cell and state its fit on the runs that no choice saw.

    Parameters
    ----------
    test_quantities : DataFrame
        Sets `TRAINING` and ``checking``; coded factors as the axis sees them.
    factors : sequence of Factor
    kinds : sequence of str
    goal : float
        Fit [%] that counts as reached.
    max_failed_share : float
        Largest share of NaN test quantities in a cell.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``; ``kind``; ``fit`` [%] (6) on the checking runs; ``ceiling``
        and ``ceiling_low`` [%], see `noise_ceiling`; ``state``: ``reached`` (fit >= goal), ``at ceiling``
        (what is missing the noise explains), ``short`` (the points are spent) or ``constant``; ``noise``
        (standard deviation of a run, from replicates), ``inside`` (share of the checking runs in their 95 %
        intervals), ``spread`` and ``spread_asked`` (see `wearscope.surrogates.selection.ChosenSurrogate`),
        ``nominal``, ``n_points``, ``n_checking``, ``n_failed``, the cross-validated fit
        ``left_out_<kind>`` of each kind tried, and ``parameters`` (JSON), with which `read_chosen` makes the
        surrogate again.

    Raises
    ------
    InputError
        Where there are no checking runs, too many failed, or too few to fit anything.
    """
    names = factor_columns(test_quantities)
    nominal = nominal_levels(factors)
    if not (test_quantities["set"] == CHECKING).any():
        raise InputError("test quantities: no row has the set 'checking'; run the checking points.")
    records = []
    for key, cell in cells_of(test_quantities):
        z, y = training_runs(cell, names, max_failed_share)
        rows = cell[cell["set"] == CHECKING].sort_values("point")
        good = usable_points(rows, key, max_failed_share)
        z_new, y_new = good[names].to_numpy(dtype=float), good["y"].to_numpy(dtype=float)
        try:
            chosen, fits = choose_surrogate(z, y, names, nominal, kinds)
        except ValueError as error:
            raise InputError(f"cell {cell_name(key)}: {error}; add points.") from error
        squares, freedom = pure_error(z, y)
        fit = model_fit(y_new, chosen.predict(z_new))
        ceiling, lowest = noise_ceiling(y_new, squares, freedom)
        low, high = chosen.prediction_interval(z_new)
        records.append(
            {
                **dict(zip(CELL, key, strict=True)),
                "kind": chosen.kind,
                "fit": fit,
                "ceiling": ceiling,
                "ceiling_low": lowest,
                "state": _state(chosen, fit, lowest, goal),
                "noise": float(np.sqrt(squares / freedom)) if freedom else np.nan,
                "inside": float(np.mean((y_new >= low) & (y_new <= high))) if len(y_new) else np.nan,
                "spread": chosen.spread,
                "spread_asked": chosen.spread_asked,
                "nominal": list(chosen.nominal),
                "n_points": len(y),
                "n_checking": len(y_new),
                "n_failed": int((~np.isfinite(cell["y"].to_numpy(dtype=float))).sum()),
                **{f"left_out_{kind}": fits.get(kind, np.nan) for kind in KINDS},
                "parameters": json.dumps({} if chosen.fitted is None else chosen.fitted.parameters),
            }
        )
    return pd.DataFrame(records)


def _state(chosen: ChosenSurrogate, fit: float, lowest: float, goal: float) -> str:
    if chosen.fitted is None:
        return "constant"
    if fit >= goal:
        return "reached"
    return "at ceiling" if fit >= lowest else "short"


def read_chosen(
    chosen: pd.DataFrame, test_quantities: pd.DataFrame
) -> Iterator[tuple[tuple, ChosenSurrogate]]:
    """Each cell's chosen surrogate with its key (robot, cycle, axis, fda), in sorted order.

    Parameters
    ----------
    chosen : DataFrame
        From `choose_surrogates`.
    test_quantities : DataFrame
        Those that it was made from.

    Raises
    ------
    InputError
        Where a cell has no training runs, or not those that its surrogate was chosen on.
    """
    names = factor_columns(test_quantities)
    cells = dict(cells_of(test_quantities))
    for row in chosen.sort_values(CELL).to_dict("records"):
        key = tuple(row[name] for name in CELL)
        if key not in cells:
            raise InputError(f"cell {cell_name(key)}: it has no test quantities; make them again.")
        z, y = training_runs(cells[key], names)
        if len(y) != row["n_points"]:
            raise InputError(
                f"cell {cell_name(key)}: its surrogate was chosen on {row['n_points']} runs, but there are "
                f"{len(y)}; choose the surrogates again."
            )
        parameters = json.loads(row["parameters"])
        spreads = float(row["spread"]), float(row["spread_asked"])
        yield (
            key,
            rebuild_surrogate(
                row["kind"], parameters, spreads[0], z, y, names, spreads[1], list(row["nominal"])
            ),
        )


def read_cells(
    model: str, test_quantities: pd.DataFrame, surrogates: pd.DataFrame, chosen: pd.DataFrame | None
) -> list[tuple[tuple, ChosenSurrogate | Surrogate]]:
    """The surrogate that answers a question, by cell (robot, cycle, axis, fda), in sorted order.

    Parameters
    ----------
    model : str
        ``chosen``, or a quadratic model.
    test_quantities, surrogates : DataFrame
    chosen : DataFrame or None
        Needed where `model` is ``chosen``.

    Raises
    ------
    InputError
        Where it is not there.
    """
    if model != CHOSEN:
        return [(key[:4], one) for key, one in surrogates_of(surrogates, model)]
    if chosen is None:
        raise InputError("surrogates: none was chosen; set surrogates.filling.enabled, or ask another model.")
    return list(read_chosen(chosen, test_quantities))


def read_noise(chosen: pd.DataFrame) -> dict[tuple, float]:
    """Standard deviation of a run by cell (robot, cycle, axis, fda); NaN without replicates."""
    return {tuple(row[name] for name in CELL): float(row["noise"]) for row in chosen.to_dict("records")}
