"""Signal-to-noise ratio of detectors (Q-2): eq. (11) with the settings (20).

For a quadratic surrogate it is computed exactly and by Monte Carlo. A chosen surrogate has no closed form, so
that its SNR comes from numerical integration, draws and Monte Carlo. The SNR is also found by direct
simulation, including robots that differ from their model.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd
import scipy
from numpy.typing import ArrayLike, NDArray
from scipy import special

from wearscope.designs.factors import CODED_HIGH, CODED_LOW, FAULT, Factor, check_factors, worn_factor
from wearscope.designs.kinds import design_table, generator_for
from wearscope.errors import InputError
from wearscope.evaluation.grouping import bootstrap_indices, central_interval
from wearscope.surrogates.chosen import CHOSEN, ChosenSurrogate
from wearscope.surrogates.fitting import (
    CELL,
    Surrogate,
    cell_name,
    cells_of,
    condition_on_fault,
)

Array = NDArray[np.float64]
#: A robot's model counts as free of noise where the noise of a run is at most this share of the magnitude of
#: y.
NOISE_FREE = 1e-12


def quadratic_moments(c: ArrayLike, g: ArrayLike, a: ArrayLike, sigma: float) -> tuple[Array, Array]:
    """Return mean and standard deviation of y = c + g'w + w'Aw for w ~ N(0, sigma^2 I).

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
    """Return change over deviation; NaN for 0/0, and signed infinity where only the deviation is 0."""
    change, deviation = np.broadcast_arrays(np.asarray(change, float), np.asarray(deviation, float))
    result = np.full(change.shape, np.nan)
    np.divide(change, deviation, out=result, where=deviation > 0)
    sure = (deviation == 0) & (change != 0)
    result[sure] = np.sign(change[sure]) * np.inf
    return result


def exact_snr(
    theta: ArrayLike, terms: tuple[str, ...], f0: float = -0.5, delta: float = 1.0, sigma: float = 0.25
) -> Array:
    """Return the exact SNR (11), from the moments of a quadratic form in Gaussian nuisances.

    Parameters
    ----------
    theta : array (..., p)
        Coefficient vectors.
    terms : tuple of str, (p,)
    f0, delta, sigma : float
        Settings (20) of the hypotheses (10), coded.

    Returns
    -------
    array (...,)
    """
    mean0, _ = quadratic_moments(*condition_on_fault(theta, terms, f0), sigma)
    mean1, deviation1 = quadratic_moments(*condition_on_fault(theta, terms, f0 + delta), sigma)
    return ratio(mean1 - mean0, deviation1)


def monte_carlo_error(y0: Array, y1: Array) -> tuple[float, float]:
    """Return the SNR (11) of runs (N,) under each hypothesis, and its Monte Carlo standard error."""
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


def sample_output(
    surrogate: Surrogate | ChosenSurrogate, rng: np.random.Generator, runs: int, f: float, sigma: float
) -> Array:
    """Draw outputs (runs,) of a surrogate at a fault level with nuisances w ~ N(0, sigma^2 I).

    Of a chosen surrogate at most `MOST_RUNS` are drawn, with nuisances clipped to the simulated range.
    """
    if not isinstance(surrogate, Surrogate):
        x = rng.standard_normal((min(runs, MOST_RUNS), len(surrogate.names) - 1))
        return surrogate.predict(place_nodes(x, surrogate.names, f, sigma))
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
    """Return the interval of the exact SNR that follows from the uncertainty of the coefficients.

    Coefficients are drawn by `Surrogate.draw_coefficients`. The interval is NaN for a constant surrogate or
    without residual degrees of freedom.
    """
    if surrogate.status == "constant" or surrogate.dof < 1:
        return float("nan"), float("nan")
    theta = surrogate.draw_coefficients(rng, draws)
    return central_interval(exact_snr(theta, surrogate.terms, f0, delta, sigma), level)


def answer_rows(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the surrogate in use: the chosen one where the table has it, else all rows."""
    chosen = table["model"] == "chosen"
    return table[chosen].reset_index(drop=True) if chosen.any() else table


def is_noise_free(noise: float, size: float) -> bool:
    """Return whether the noise of a run is zero up to rounding, so that only nuisances cause variation."""
    return noise <= NOISE_FREE * size


def output_status(surrogate: Surrogate) -> str:
    """Return ``constant``, ``decreasing`` (the fault's direct effect theta_0 is negative) or ``ok``."""
    if surrogate.status == "constant":
        return "constant"
    return "decreasing" if surrogate.coefficient("f") < 0 else "ok"


#: Points of the numerical integration for the mean response; points for each drawn response function; most
#: Monte Carlo runs of a chosen surrogate.
NODES = 4096
DRAW_NODES = 256
MOST_RUNS = 20_000
#: Names of the streams of random numbers for runs and for draws, of a quadratic surrogate and of another one.
_STREAMS = {True: ("snr", "snr interval"), False: ("sampled snr", "snr draws")}


def normal_nodes(columns: int, nodes: int) -> Array:
    """Return standard normal quasi-random points (nodes, columns): a Sobol' sequence, fixed scrambling."""
    sampler = scipy.stats.qmc.Sobol(columns, rng=generator_for(0, "normal nodes", columns))
    inner = np.clip(sampler.random_base2(int(np.log2(nodes))), 1e-12, 1 - 1e-12)
    return special.ndtri(inner)


def place_nodes(x: Array, names: tuple[str, ...], f: float, sigma: float) -> Array:
    """Return coded points (M, n): the fault at `f`, nuisances sigma x clipped to the simulated range."""
    z = np.empty((len(x), len(names)))
    k = names.index(FAULT)
    z[:, k] = f
    z[:, [j for j in range(len(names)) if j != k]] = np.clip(sigma * x, CODED_LOW, CODED_HIGH)
    return z


def quadrature_snr(
    surrogate: ChosenSurrogate, f0: float = -0.5, delta: float = 1.0, sigma: float = 0.25, nodes: int = NODES
) -> float:
    """Return the SNR (11) of the mean response, with the same quasi-random nuisances for both hypotheses."""
    x = normal_nodes(len(surrogate.names) - 1, nodes)
    y0 = surrogate.predict(place_nodes(x, surrogate.names, f0, sigma))
    y1 = surrogate.predict(place_nodes(x, surrogate.names, f0 + delta, sigma))
    return float(ratio(y1.mean() - y0.mean(), y1.std()))


def draw_snr(
    surrogate: ChosenSurrogate,
    rng: np.random.Generator,
    draws: int = 400,
    f0: float = -0.5,
    delta: float = 1.0,
    sigma: float = 0.25,
    noise: float = 0.0,
) -> Array:
    """Return the SNR (draws,), eq. (11), of response functions drawn from a surrogate.

    `noise` is the standard deviation of single runs; it adds to the variation by nuisances.
    """
    x = normal_nodes(len(surrogate.names) - 1, DRAW_NODES)
    both = [place_nodes(x, surrogate.names, f, sigma) for f in (f0, f0 + delta)]
    y = surrogate.draw(np.vstack(both), rng, draws)
    y0, y1 = y[:, : len(x)], y[:, len(x) :]
    return ratio(y1.mean(axis=1) - y0.mean(axis=1), np.hypot(y1.std(axis=1), noise))


def snr_table(
    cells: Iterable[tuple[tuple, ChosenSurrogate | Surrogate]],
    f0: float = -0.5,
    delta: float = 1.0,
    sigma: float = 0.25,
    runs: int = 100_000,
    seed: int = 0,
    level: float = 0.95,
    draws: int | None = None,
    noise: Mapping[tuple, float] | None = None,
) -> pd.DataFrame:
    """Compute the SNR of every cell from its surrogate.

    Parameters
    ----------
    cells : iterable of (key, surrogate)
        From `wearscope.surrogates.fitting.surrogates_of` or `wearscope.surrogates.chosen.read_chosen`.
    f0, delta, sigma : float
        Coded, as in (20).
    runs : int
        Monte Carlo runs under each hypothesis; at most `MOST_RUNS` are made of a chosen surrogate.
    seed : int
        Root seed; each cell has its own random stream, which depends on its name.
    level : float
        Level of the interval ``snr_low``, ``snr_high``.
    draws : int, optional
        Number of draws for that interval: of coefficients, 2000 unless given, or of response functions of a
        chosen surrogate, 400 unless given.
    noise : mapping, optional
        Standard deviation of a run by cell, from replicates; 0 means that the robot's model has no noise.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``model``, ``snr`` (Monte Carlo), ``snr_exact`` (by numerical
        integration for a chosen surrogate), ``snr_low``, ``snr_high`` (interval of the exact SNR from the
        uncertainty of the surrogate), ``snr_stderr`` (Monte Carlo error), ``status``: ``ok``, ``constant`` or
        ``noise-free`` (SNR NaN), or ``decreasing`` (y falls with the fault).
    """
    if runs < 2 or sigma < 0:
        raise InputError(f"snr: runs {runs} and sigma {sigma} must be at least 2 and 0; correct the setting.")
    columns = [*CELL, "model", "snr", "snr_exact", "snr_low", "snr_high", "snr_stderr", "status"]
    records, setting = [], (f0, delta, sigma)
    for key, surrogate in cells:
        quadratic = isinstance(surrogate, Surrogate)
        cell, model, status = key[: len(CELL)], key[-1] if quadratic else CHOSEN, surrogate.status
        numbers = [np.nan] * 5
        if status != "constant" and noise and is_noise_free(noise[cell], response_size(surrogate)):
            status = "noise-free"
        elif status != "constant":
            rng, other = (generator_for(seed, one, cell_name(key)) for one in _STREAMS[quadratic])
            sampled = [sample_output(surrogate, rng, runs, f, sigma) for f in (f0, f0 + delta)]
            if isinstance(surrogate, Surrogate):
                exact = float(exact_snr(surrogate.theta, surrogate.terms, *setting))
                status = output_status(surrogate)
                interval = parametric_interval(surrogate, other, draws or 2000, level, *setting)
            else:
                exact = quadrature_snr(surrogate, *setting)
                status = "decreasing" if exact < 0 else "ok"
                interval = central_interval(draw_snr(surrogate, other, draws or 400, *setting), level)
            snr, error = monte_carlo_error(*sampled)
            numbers = [snr, exact, *interval, error]
        records.append([*cell, model, *numbers, status])
    return pd.DataFrame(records, columns=columns)


def response_size(surrogate: ChosenSurrogate | Surrogate) -> float:
    """Return the magnitude of y at the design's centre."""
    if isinstance(surrogate, Surrogate):
        return abs(float(surrogate.theta[0]))
    centre = surrogate.predict(np.zeros((1, len(surrogate.names))))
    return float(np.abs(centre).max())


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
    """Design the runs that find an SNR (11) by direct simulation: `runs` under H0, then `runs` under H1.

    Both hypotheses have the same nuisances, clipped to -2..2, so that their difference varies less.

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
        Where `runs` is less than 2.
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
    """Return the first pairs of a direct design, and nominal runs, for a robot that differs from its model.

    Parameters
    ----------
    direct : DataFrame
        From `direct_design`.
    nominal : DataFrame
        Nominal design, whose runs the detectors learn from; they too are simulated with the different robot.
    mismatch : mapping of str to float
        Numbers of the robot that differ, by path.
    runs : int
        Number of pairs.

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
    """Compare the SNR where the robot differs from the detectors' model with that where it does not.

    Parameters
    ----------
    test_quantities : DataFrame
        Test quantities of the pairs of a `mismatch_design`.
    direct : DataFrame
        From `direct_table`.
    seed : int
        Seed of the bootstrap over the runs.

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
    """Compare the SNR by direct simulation with that by the chosen surrogate, cell by cell.

    Single runs also vary with the sensors' noise. So the surrogate's value here includes the noise of a run.
    Its SNR in ``snr.parquet`` does not, and is larger or equal.

    Parameters
    ----------
    test_quantities : DataFrame
        Test quantities of the set ``direct``.
    design : DataFrame
        From `direct_design`.
    chosen : mapping
        Chosen surrogate by cell.
    noise : mapping, optional
        Standard deviation of a run by cell, from replicates. Where it is missing or NaN, the surrogate's own
        estimate is used, which includes its misfit.
    f0, delta, sigma : float
        Settings of the design.
    seed, level, draws
        Settings of the bootstrap over the runs, and of the surrogate's draws (at most 400).

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``runs`` (pairs in which both hypotheses have a value),
        ``n_failed``, ``snr_direct`` with ``direct_low``, ``direct_high``, ``snr_surrogate`` with
        ``surrogate_low``, ``surrogate_high``, ``agrees`` (whether the intervals overlap; None where either is
        missing). A model without noise has no SNR; then all of these are NaN.

    Raises
    ------
    InputError
        Where there are no direct rows, or a cell has no surrogate.
    """
    rows = test_quantities[test_quantities["set"] == DIRECT]
    if rows.empty:
        raise InputError("direct: no test quantity has the set 'direct'; simulate the direct points first.")
    half = len(design) // 2
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
            said = [float(np.median(answers)), *central_interval(answers, level)]
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
    """Return the values (2, N) under H0 and H1 of the pairs in which both are finite."""
    y = cell.sort_values("point")["y"].to_numpy(dtype=float).reshape(2, -1)
    return y[:, np.isfinite(y).all(axis=0)]


def _sample(
    y: np.ndarray, free: bool, key: tuple, seed: int, level: float = 0.95, draws: int = 2000
) -> tuple[float, float, float]:
    """Return the SNR of pairs (2, N) and its bootstrap interval; NaN with too few pairs or without noise."""
    if y.shape[1] < 2 or free:
        return np.nan, np.nan, np.nan
    index = bootstrap_indices(y.shape[1], draws, generator_for(seed, "direct", cell_name(key)))
    return _snr(y), *central_interval([_snr(y[:, one]) for one in index], level)


def _snr(y: np.ndarray) -> float:
    """Return the SNR (11) of runs (2, N) under H0 and H1."""
    return float(ratio(y[1].mean() - y[0].mean(), y[1].std(ddof=1)))
