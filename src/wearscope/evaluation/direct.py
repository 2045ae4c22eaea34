"""The SNR's question asked of the simulator itself, also where the robot differs from its model."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from wearscope.designs.factors import CODED_HIGH, CODED_LOW, Factor, check_factors, worn_factor
from wearscope.designs.kinds import design_table, generator_for
from wearscope.errors import InputError
from wearscope.evaluation.grouping import bootstrap_indices
from wearscope.evaluation.snr import draw_snr, is_noise_free, ratio, response_size
from wearscope.surrogates.fitting import CELL, cell_name, cells_of
from wearscope.surrogates.selection import ChosenSurrogate

DIRECT = "direct"


def direct_design(
    factors: Sequence[Factor],
    runs: int = 60,
    axis: int = 1,
    f0: float = -0.5,
    delta: float = 1.0,
    sigma: float = 0.25,
    seed: int = 0,
) -> pd.DataFrame:
    """Runs that ask the simulator for an SNR (11): `runs` under H0, then `runs` under H1.

    Both hypotheses draw the same nuisances, held within -2..2, so that their difference scatters less.

    Parameters
    ----------
    factors : sequence of Factor
    runs : int
    axis : int
        The axis under test.
    f0, delta, sigma : float
        Coded, as in (20).
    seed : int

    Returns
    -------
    DataFrame
        ``point`` (from 1), coded and natural columns as simulated, ``hypothesis``, ``axis``.

    Raises
    ------
    InputError
        Fewer than 2 runs.
    """
    check_factors(factors)
    if runs < 2:
        raise InputError(f"direct: {runs} runs; give at least 2.")
    names = [factor.name for factor in factors]
    drawn = sigma * generator_for(seed, "direct").standard_normal((runs, len(names)))
    rows = []
    for f in (f0, f0 + delta):
        z = np.clip(drawn, CODED_LOW, CODED_HIGH)
        z[:, names.index(worn_factor(factors, axis))] = f
        rows.append(z)
    return design_table(np.vstack(rows), factors).assign(hypothesis=np.repeat(["H0", "H1"], runs), axis=axis)


def mismatch_design(
    direct: pd.DataFrame, nominal: pd.DataFrame, mismatch: Mapping[str, float], runs: int
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """First pairs of a direct design, and nominal runs, on a robot that differs from its model.

    Parameters
    ----------
    direct : DataFrame
        From `direct_design`.
    nominal : DataFrame
        The nominal design; the detectors learn from this robot too.
    mismatch : mapping of str to float
        Number of the robot by path.
    runs : int
        Pairs.

    Returns
    -------
    pairs, nominal : DataFrame
        With a column of natural levels for each path.
    """
    half = len(direct) // 2
    count = min(runs, half)
    pairs = pd.concat([direct.iloc[first : first + count] for first in (0, half)], ignore_index=True)
    levels = {f"{path}_natural": float(value) for path, value in mismatch.items()}
    return pairs.assign(point=np.arange(1, 2 * count + 1), **levels), nominal.assign(**levels)


def mismatch_table(
    test_quantities: pd.DataFrame,
    direct: pd.DataFrame,
    seed: int = 0,
) -> pd.DataFrame:
    """SNR where the robot differs from the detectors' model, next to that where it does not.

    Parameters
    ----------
    test_quantities : DataFrame
        Of the pairs of a `mismatch_design`.
    direct : DataFrame
        From `direct_table`.
    seed : int
        Of the bootstrap over the runs.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``runs``, ``n_failed``, ``snr_ideal`` with ``ideal_low``,
        ``ideal_high``, and ``snr_mismatch`` with ``mismatch_low``, ``mismatch_high``.
    """
    ideal = direct.set_index(CELL)
    records = []
    for key, cell in cells_of(test_quantities):
        known = ideal.loc[key]
        y = _pairs(cell)
        free = not np.isfinite(known["snr_direct"])
        value, low, high = _sample(y, free, key, seed)
        records.append(
            {
                **dict(zip(CELL, key, strict=True)),
                "runs": y.shape[1],
                "n_failed": len(cell) // 2 - y.shape[1],
                "snr_ideal": known["snr_direct"],
                "ideal_low": known["direct_low"],
                "ideal_high": known["direct_high"],
                "snr_mismatch": value,
                "mismatch_low": low,
                "mismatch_high": high,
            }
        )
    return pd.DataFrame(records)


def direct_table(
    test_quantities: pd.DataFrame,
    design: pd.DataFrame,
    chosen: Mapping[tuple, ChosenSurrogate],
    noise: Mapping[tuple, float] | None = None,
    f0: float = -0.5,
    delta: float = 1.0,
    sigma: float = 0.25,
    seed: int = 0,
    level: float = 0.95,
    draws: int = 2000,
) -> pd.DataFrame:
    """SNR by direct simulation and by the chosen surrogate, cell by cell.

    Single runs also scatter with the sensors' noise, so the surrogate's value includes it: its response plus
    the noise of a run. Its SNR in ``snr.parquet``, without that noise, is larger or equal.

    Parameters
    ----------
    test_quantities : DataFrame
        Set ``direct``.
    design : DataFrame
        From `direct_design`.
    chosen : mapping
        Chosen surrogate by cell.
    noise : mapping, optional
        Standard deviation of a run by cell, from replicates. Where it is missing or NaN, the surrogate's own
        estimate is used, which holds its misfit too.
    f0, delta, sigma : float
        As the design was made with.
    seed, level, draws
        Of the bootstrap over the runs, and of the surrogate's draws (at most 400).

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``runs`` (pairs in which both hypotheses have a value),
        ``n_failed``, ``snr_direct`` with ``direct_low``, ``direct_high``, ``snr_surrogate`` with
        ``surrogate_low``, ``surrogate_high``, ``agrees`` (the intervals overlap; None where either has none).
        A model without noise has no SNR: all of these are NaN.

    Raises
    ------
    InputError
        Where there are no direct rows, or a cell has no surrogate.
    """
    rows = test_quantities[test_quantities["set"] == DIRECT]
    if rows.empty:
        raise InputError("direct: no test quantity has the set 'direct'; simulate the direct points first.")
    half = len(design) // 2
    tail = [0.5 - level / 2, 0.5 + level / 2]
    records = []
    for key, cell in cells_of(rows):
        if key not in chosen:
            raise InputError(f"direct: cell {cell_name(key)} has no chosen surrogate; choose one first.")
        surrogate = chosen[key]
        good = _pairs(cell)
        known_noise = (noise or {}).get(key, np.nan)
        free = surrogate.status == "ok" and is_noise_free(known_noise, response_size(surrogate))
        value, low, high = _sample(good, free, key, seed, level, draws)
        said = [np.nan] * 3
        if surrogate.status == "ok" and not free:
            stream = generator_for(seed, "direct surrogate", cell_name(key))
            scatter = surrogate.noise if np.isnan(known_noise) else known_noise
            answers = draw_snr(surrogate, stream, min(draws, 400), f0, delta, sigma, scatter)
            said = [float(one) for one in np.quantile(answers, [0.5, *tail])]
        known = np.isfinite([low, high, *said]).all()
        records.append(
            {
                **dict(zip(CELL, key, strict=True)),
                "runs": good.shape[1],
                "n_failed": half - good.shape[1],
                "snr_direct": value,
                "direct_low": low,
                "direct_high": high,
                "snr_surrogate": said[0],
                "surrogate_low": said[1],
                "surrogate_high": said[2],
                "agrees": bool(low <= said[2] and said[1] <= high) if known else None,
            }
        )
    return pd.DataFrame(records)


def _pairs(cell: pd.DataFrame) -> np.ndarray:
    """Values (2, N) under H0 and H1 of the pairs in which both have one."""
    y = cell.sort_values("point")["y"].to_numpy(dtype=float).reshape(2, -1)
    return y[:, np.isfinite(y).all(axis=0)]


def _sample(
    y: np.ndarray, free: bool, key: tuple, seed: int, level: float = 0.95, draws: int = 2000
) -> tuple[float, float, float]:
    """SNR of pairs (2, N) with its interval; NaN where there are too few, or the model is free of noise."""
    low, high = np.nan, np.nan
    if y.shape[1] < 2 or free:
        return np.nan, low, high
    index = bootstrap_indices(y.shape[1], draws, generator_for(seed, "direct", cell_name(key)))
    again = np.array([_snr(y[:, one]) for one in index])
    again = again[np.isfinite(again)]
    if again.size:
        low, high = np.quantile(again, [0.5 - level / 2, 0.5 + level / 2])
    return _snr(y), float(low), float(high)


def _snr(y: np.ndarray) -> float:
    """SNR (11) of runs (2, N) under H0 and H1."""
    return float(ratio(y[1].mean() - y[0].mean(), y[1].std(ddof=1)))
