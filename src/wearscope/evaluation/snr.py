"""Comparing detectors (Q-2): the signal-to-noise ratio (11) under (20), by Monte Carlo and exactly."""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from wearscope.designs.seeds import generator_for
from wearscope.errors import InputError
from wearscope.evaluation.grouping import bootstrap_indices, box_statistics, check_group, groups_of
from wearscope.surrogates.fitting import CELL, cell_name, surrogates_of
from wearscope.surrogates.surrogate import Surrogate, condition_on_fault

Array = NDArray[np.float64]
#: Fewer cells than these say nothing by being resampled.
FEW = 5
#: Noise of a run, over the size of y, below which a robot's model counts as free of noise.
NOISE_FREE = 1e-12


def quadratic_moments(c: ArrayLike, g: ArrayLike, a: ArrayLike, sigma: float) -> tuple[Array, Array]:
    """Mean and standard deviation of y = c + g'w + w'Aw for w ~ N(0, sigma^2 I).

    Parameters
    ----------
    c : array (...,)
    g : array (..., m)
    a : array (..., m, m)
        Symmetric.
    sigma : float

    Returns
    -------
    mean, deviation : array (...,)
        c + sigma^2 tr A; sqrt(sigma^2 g'g + 2 sigma^4 tr A^2).
    """
    g, a = np.asarray(g, dtype=float), np.asarray(a, dtype=float)
    mean = np.asarray(c, dtype=float) + sigma**2 * np.trace(a, axis1=-2, axis2=-1)
    variance = sigma**2 * np.sum(g * g, axis=-1) + 2 * sigma**4 * np.sum(a * a, axis=(-2, -1))
    return mean, np.sqrt(variance)


def ratio(change: ArrayLike, deviation: ArrayLike) -> Array:
    """Change over deviation; NaN for 0/0, signed infinity for a change without deviation."""
    change, deviation = np.broadcast_arrays(np.asarray(change, float), np.asarray(deviation, float))
    result = np.full(change.shape, np.nan)
    np.divide(change, deviation, out=result, where=deviation > 0)
    sure = (deviation == 0) & (change != 0)
    result[sure] = np.sign(change[sure]) * np.inf
    return result


def exact_snr(
    theta: ArrayLike, terms: tuple[str, ...], f0: float = -0.5, delta: float = 1.0, sigma: float = 0.25
) -> Array:
    """SNR (11) from the moments of a quadratic form in Gaussian nuisances.

    Parameters
    ----------
    theta : array (..., p)
        Coefficients, any number of vectors.
    terms : tuple of str, (p,)
    f0, delta, sigma : float
        The hypotheses (10) as set in (20), coded.

    Returns
    -------
    array (...,)
    """
    mean0, _ = quadratic_moments(*condition_on_fault(theta, terms, f0), sigma)
    mean1, deviation1 = quadratic_moments(*condition_on_fault(theta, terms, f0 + delta), sigma)
    return ratio(mean1 - mean0, deviation1)


def monte_carlo_snr(
    surrogate: Surrogate,
    rng: np.random.Generator,
    runs: int = 100_000,
    f0: float = -0.5,
    delta: float = 1.0,
    sigma: float = 0.25,
) -> tuple[float, float]:
    """SNR (11) by `runs` Monte Carlo runs under each hypothesis.

    Returns
    -------
    snr : float
    stderr : float
        Its Monte Carlo standard error, by the delta method on the sample means and deviation.
    """
    return monte_carlo_error(*sample_hypotheses(surrogate, rng, runs, f0, delta, sigma))


def sample_hypotheses(
    surrogate: Surrogate, rng: np.random.Generator, runs: int, f0: float, delta: float, sigma: float
) -> tuple[Array, Array]:
    """Outputs (runs,) of a surrogate under each hypothesis."""
    first = sample_output(surrogate, rng, runs, f0, sigma)
    return first, sample_output(surrogate, rng, runs, f0 + delta, sigma)


def monte_carlo_error(y0: Array, y1: Array) -> tuple[float, float]:
    """SNR (11) of runs (N,) under each hypothesis, and its Monte Carlo standard error."""
    runs = len(y1)
    centred = y1 - y1.mean()
    m2, m3, m4 = (float(np.mean(centred**k)) for k in (2, 3, 4))
    change = float(y1.mean() - y0.mean())
    scale = max(abs(float(y1.mean())), abs(change))
    if m2 <= (1e-12 * scale) ** 2:
        return float(ratio(0.0 if abs(change) <= 1e-12 * scale else change, 0.0)), 0.0
    deviation = float(np.sqrt(m2 * runs / (runs - 1)))
    snr = change / deviation
    variance = (m2 + float(y0.var())) / runs
    variance += snr**2 * (m4 - m2**2) / (4 * m2 * runs)
    variance -= snr * m3 / (m2 * runs) * deviation
    return snr, float(np.sqrt(max(variance, 0.0)) / deviation)


def sample_output(surrogate: Surrogate, rng: np.random.Generator, runs: int, f: float, sigma: float) -> Array:
    """Outputs (runs,) of a surrogate at a fault level under nuisances w ~ N(0, sigma^2 I)."""
    c, g, a = surrogate.at_fault(f)
    w = rng.standard_normal((runs, g.size))
    w *= sigma
    product = w @ a
    product += g
    product *= w
    return product.sum(axis=1) + c


def parametric_interval(
    surrogate: Surrogate,
    rng: np.random.Generator,
    draws: int = 2000,
    level: float = 0.95,
    f0: float = -0.5,
    delta: float = 1.0,
    sigma: float = 0.25,
) -> tuple[float, float]:
    """Interval of the exact SNR that the uncertainty of the coefficients allows.

    Coefficients are drawn by `Surrogate.draw_coefficients`; NaN without residual degrees of freedom.
    """
    if surrogate.status == "constant" or surrogate.dof < 1:
        return float("nan"), float("nan")
    values = exact_snr(surrogate.draw_coefficients(rng, draws), surrogate.terms, f0, delta, sigma)
    low, high = np.quantile(values, [0.5 - level / 2, 0.5 + level / 2])
    return float(low), float(high)


def describe_snr(
    key: Sequence[str | int],
    model: str,
    status: str,
    runs: tuple[Array, Array] | None = None,
    exact: float = np.nan,
    interval: tuple[float, float] = (np.nan, np.nan),
) -> dict[str, object]:
    """Row of ``snr.parquet``.

    Parameters
    ----------
    key : sequence
        Cell.
    model, status : str
    runs : pair of array (N,), optional
        Monte Carlo runs under each hypothesis; NaN where there is no SNR.
    exact : float
    interval : pair of float
        Of the exact SNR.
    """
    snr, error = (np.nan, np.nan) if runs is None else monte_carlo_error(*runs)
    return {
        **dict(zip(CELL, key, strict=True)),
        "model": model,
        "snr": snr,
        "snr_exact": float(exact),
        "snr_low": float(interval[0]),
        "snr_high": float(interval[1]),
        "snr_stderr": error,
        "status": status,
    }


def snr_table(
    surrogates: pd.DataFrame,
    model: str = "full",
    f0: float = -0.5,
    delta: float = 1.0,
    sigma: float = 0.25,
    runs: int = 100_000,
    seed: int = 0,
    level: float = 0.95,
    draws: int = 2000,
    noise: Mapping[tuple, float] | None = None,
) -> pd.DataFrame:
    """SNR of every cell.

    Parameters
    ----------
    surrogates : DataFrame
        From `wearscope.surrogates.fitting.fit_surrogates`.
    model : str
    f0, delta, sigma : float
        Coded, as in (20).
    runs : int
        Monte Carlo runs under each hypothesis.
    seed : int
        Root seed; each cell has its own stream, keyed by its name.
    level : float
        Of ``snr_low``, ``snr_high``.
    draws : int
        Coefficient draws for that interval.
    noise : mapping, optional
        Standard deviation of a run by cell, from replicates; 0 says that the robot's model has no noise.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``model``, ``snr`` (Monte Carlo), ``snr_exact``, ``snr_low``,
        ``snr_high`` (of the exact SNR, from the uncertainty of the coefficients), ``snr_stderr`` (Monte
        Carlo error), ``status``: ``ok``, ``constant`` or
        ``noise-free`` (SNR NaN), or ``decreasing`` (theta_0 < 0).
    """
    if runs < 2 or sigma < 0:
        raise InputError(f"snr: runs {runs} and sigma {sigma} must be at least 2 and 0; correct the setting.")
    records = []
    for key, surrogate in surrogates_of(surrogates, model):
        setting = (f0, delta, sigma)
        name = cell_name(key)
        if noise is not None and is_noise_free(noise[key[:-1]], abs(float(surrogate.theta[0]))):
            records.append(describe_snr(key[:-1], key[-1], "noise-free"))
            continue
        sampled = sample_hypotheses(surrogate, generator_for(seed, "snr", name), runs, *setting)
        interval = parametric_interval(
            surrogate, generator_for(seed, "snr interval", name), draws, level, *setting
        )
        exact = float(exact_snr(surrogate.theta, surrogate.terms, *setting))
        records.append(describe_snr(key[:-1], key[-1], output_status(surrogate), sampled, exact, interval))
    return pd.DataFrame(records)


def is_noise_free(noise: float, size: float) -> bool:
    """Whether a run's standard deviation is none beside y's size: nothing but the nuisances scatters."""
    return noise <= NOISE_FREE * size


def output_status(surrogate: Surrogate) -> str:
    """``constant``, ``decreasing`` (the direct effect theta_0 of the fault is negative) or ``ok``."""
    if surrogate.status == "constant":
        return "constant"
    return "decreasing" if surrogate.coefficient("f") < 0 else "ok"


def snr_boxes(snr: pd.DataFrame, by: Sequence[str] = ("fda",), value: str = "snr") -> pd.DataFrame:
    """Box-plot statistics of the SNR of each group (Fig. 3)."""
    return pd.DataFrame(
        [
            {**dict(zip(by, key, strict=True)), **box_statistics(rows[value])}
            for key, rows in groups_of(snr, by)
        ]
    )


def rank_by_median(
    table: pd.DataFrame,
    value: str = "snr_exact",
    by: Sequence[str] = ("fda",),
    draws: int = 2000,
    seed: int = 0,
    level: float = 0.95,
) -> pd.DataFrame:
    """Rank groups by their median, with what the choice of cells leaves open.

    The remaining design parameters are resampled together (a cell that every group shares is drawn for all of
    them at once), so that differences between groups are paired. Where a group has values in fewer than `FEW`
    of them, resampling says nothing: there the cells' own intervals decide, a group's being the medians of
    its cells' ends, and a group without intervals is tied with every other.

    Parameters
    ----------
    table : DataFrame
        One row a cell.
    value : str
        Column to rank by, larger is better; NaN rows are left out and counted.
    by : sequence of str
        Design parameters that form the groups.
    draws : int
        Bootstrap draws.
    seed : int
    level : float

    Returns
    -------
    DataFrame
        Best first: the group columns, ``n``, ``n_nan``, ``median``, ``median_low``, ``median_high``,
        ``rank`` (1 is best), ``rank_low``, ``rank_high`` (interval), ``tied_with`` (groups whose median
        difference has an interval that holds 0, or whose own interval overlaps), ``interval_from``: ``choice
        of cells`` or ``each cell``.

    Raises
    ------
    InputError
        Where `by` is empty or leaves no cell to compare over.
    """
    by = check_group(by)
    rest = [name for name in CELL if name not in by]
    if not by or not rest:
        raise InputError("ranking: group by some, not all, of robot, cycle, axis and fda.")
    wide = table.pivot(index=rest, columns=by, values=value).sort_index(axis=0).sort_index(axis=1)
    values = wide.to_numpy(dtype=float)
    keys = [key if isinstance(key, tuple) else (key,) for key in wide.columns]
    held = np.sum(~np.isnan(values), axis=0)
    if len(values) < FEW or np.any((held > 0) & (held < FEW)):
        low, high = (
            table.pivot(index=rest, columns=by, values=name).reindex_like(wide).to_numpy(dtype=float)
            if name in table.columns
            else np.full_like(values, np.nan)
            for name in ("snr_low", "snr_high")
        )
        return _rank_few(values, low, high, keys, by)
    stream = generator_for(seed, "rank", value, *by)
    median = _median(values)
    # Drawn one at a time: all at once they would take draws times the memory of the values.
    boot = np.stack([_median(values[bootstrap_indices(len(values), 1, stream)[0]]) for _ in range(draws)])
    tail = 0.5 - level / 2
    order = np.argsort(-np.where(np.isnan(median), -np.inf, median), kind="stable")
    filled = np.where(np.isnan(boot), -np.inf, boot)
    ranks = 1 + np.sum(filled[:, None, :] > filled[:, :, None], axis=2)  # equals share the better rank
    tied: list[list[str]] = [[] for _ in keys]
    for i, j in combinations(range(len(keys)), 2):
        difference = boot[:, i] - boot[:, j]
        difference = difference[np.isfinite(difference)]
        if difference.size == 0:
            continue
        low, high = np.quantile(difference, [tail, 1 - tail])
        if low <= 0 <= high:
            tied[i].append(cell_name(keys[j]))
            tied[j].append(cell_name(keys[i]))
    records = []
    for position, k in enumerate(order):
        good = boot[:, k][np.isfinite(boot[:, k])]
        low, high = np.quantile(good, [tail, 1 - tail]) if good.size else (np.nan, np.nan)
        best, worst = np.quantile(ranks[:, k], [tail, 1 - tail], method="nearest")
        records.append(
            {
                **dict(zip(by, keys[k], strict=True)),
                "n": int(np.sum(~np.isnan(values[:, k]))),
                "n_nan": int(np.sum(np.isnan(values[:, k]))),
                "median": float(median[k]),
                "median_low": float(low),
                "median_high": float(high),
                "rank": position + 1,
                "rank_low": int(best),
                "rank_high": int(worst),
                "tied_with": ", ".join(tied[k]),
                "interval_from": "choice of cells",
            }
        )
    return pd.DataFrame(records)


def _rank_few(values: Array, low: Array, high: Array, keys: list[tuple], by: Sequence[str]) -> pd.DataFrame:
    """Ranking of few cells (N, G) by their own intervals; a group without one is tied with every other."""
    median, low, high = _median(values), _median(low), _median(high)
    known = np.isfinite(median)
    bottom, top = np.where(np.isfinite(low), low, -np.inf), np.where(np.isfinite(high), high, np.inf)
    records = []
    for position, k in enumerate(np.argsort(-np.where(known, median, -np.inf), kind="stable")):
        others = [j for j in range(len(keys)) if j != k and known[j]]
        above = [j for j in others if bottom[j] > top[k]]
        below = [j for j in others if top[j] < bottom[k]]
        tied = [j for j in others if j not in above and j not in below] if known[k] else []
        records.append(
            {
                **dict(zip(by, keys[k], strict=True)),
                "n": int(np.sum(~np.isnan(values[:, k]))),
                "n_nan": int(np.sum(np.isnan(values[:, k]))),
                "median": float(median[k]),
                "median_low": float(low[k]),
                "median_high": float(high[k]),
                "rank": position + 1,
                "rank_low": 1 + len(above) if known[k] else position + 1,
                "rank_high": len(others) + 1 - len(below) if known[k] else len(keys),
                "tied_with": ", ".join(cell_name(keys[j]) for j in tied),
                "interval_from": "each cell",
            }
        )
    return pd.DataFrame(records)


def _median(values: Array) -> Array:
    """Median of each column, NaN left out; NaN where nothing is left."""
    missing = np.isnan(values)
    if len(values) and not missing.any():  # a ranking asks thousands of times
        return np.asarray(np.median(values, axis=0))
    result = np.full(values.shape[1], np.nan)
    for k in range(values.shape[1]):
        good = values[:, k][~missing[:, k]]
        if good.size:
            result[k] = np.median(good)
    return result
