"""SNR (11) of a chosen surrogate, which has no closed moments: by quadrature, by draws and by Monte Carlo."""

from collections.abc import Iterable

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from wearscope.designs.factors import CODED_HIGH, CODED_LOW, FAULT
from wearscope.designs.kinds import generator_for
from wearscope.evaluation.snr import describe_snr, is_noise_free, ratio
from wearscope.surrogates.fitting import cell_name
from wearscope.surrogates.selection import CHOSEN, ChosenSurrogate

Array = NDArray[np.float64]
NODES = 4096
DRAW_NODES = 256
MOST_RUNS = 20_000


def normal_nodes(columns: int, nodes: int) -> Array:
    """Standard normal quasi-random points (nodes, columns): a Sobol' sequence with a fixed scrambling."""
    from scipy.stats import qmc  # here, because importing it takes a second

    sampler = qmc.Sobol(columns, rng=generator_for(0, "normal nodes", columns))
    inner = np.clip(sampler.random_base2(int(np.log2(nodes))), 1e-12, 1 - 1e-12)
    return special.ndtri(inner)


def place_nodes(x: Array, names: tuple[str, ...], f: float, sigma: float) -> Array:
    """Coded points (M, n): the fault at `f`, nuisances sigma x held within the levels that were simulated."""
    z = np.empty((len(x), len(names)))
    k = names.index(FAULT)
    z[:, k] = f
    z[:, [j for j in range(len(names)) if j != k]] = np.clip(sigma * x, CODED_LOW, CODED_HIGH)
    return z


def quadrature_snr(
    surrogate: ChosenSurrogate, f0: float = -0.5, delta: float = 1.0, sigma: float = 0.25, nodes: int = NODES
) -> float:
    """SNR (11) of the mean response, both hypotheses on the same quasi-random nuisances."""
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
    """SNR (11) of response functions that the runs allow, shape (draws,); with the `noise` of single runs."""
    x = normal_nodes(len(surrogate.names) - 1, DRAW_NODES)
    both = [place_nodes(x, surrogate.names, f, sigma) for f in (f0, f0 + delta)]
    y = surrogate.draw(np.vstack(both), rng, draws)
    y0, y1 = y[:, : len(x)], y[:, len(x) :]
    return ratio(y1.mean(axis=1) - y0.mean(axis=1), np.hypot(y1.std(axis=1), noise))


def sampled_snr_table(
    chosen: Iterable[tuple[tuple, ChosenSurrogate]],
    noise: dict[tuple, float] | None = None,
    f0: float = -0.5,
    delta: float = 1.0,
    sigma: float = 0.25,
    runs: int = 100_000,
    seed: int = 0,
    level: float = 0.95,
    draws: int = 400,
) -> pd.DataFrame:
    """SNR of every cell's chosen surrogate.

    Parameters
    ----------
    chosen : iterable of (key, ChosenSurrogate)
        From `wearscope.surrogates.chosen.read_chosen`.
    noise : dict, optional
        Standard deviation of a run by key, from replicates; 0 says that the robot's model has no noise.
    f0, delta, sigma : float
        Coded, as in (20).
    runs : int
        Monte Carlo runs under each hypothesis, of which at most `MOST_RUNS` are made.
    seed : int
    level : float
        Of ``snr_low``, ``snr_high``.
    draws : int
        Response functions drawn for that interval.

    Returns
    -------
    DataFrame
        As `wearscope.evaluation.snr.snr_table`, with ``model`` ``chosen``; ``snr_exact`` is by quadrature.
        ``status`` may also be ``noise-free``: there nothing but the nuisances scatters and the SNR is NaN.
    """
    records = []
    for key, surrogate in chosen:
        setting = (f0, delta, sigma)
        status, name = surrogate.status, cell_name(key)
        if noise is not None and status == "ok" and is_noise_free(noise[key], response_size(surrogate)):
            status = "noise-free"
        if status != "ok":
            records.append(describe_snr(key, CHOSEN, status))
            continue
        rng = generator_for(seed, "sampled snr", name)
        shape = min(runs, MOST_RUNS), len(surrogate.names) - 1
        first, second = (
            surrogate.predict(place_nodes(rng.standard_normal(shape), surrogate.names, f, sigma))
            for f in (f0, f0 + delta)
        )
        drawn = draw_snr(surrogate, generator_for(seed, "snr draws", name), draws, *setting)
        low, high = np.quantile(drawn, [0.5 - level / 2, 0.5 + level / 2])
        exact = quadrature_snr(surrogate, *setting)
        status = "decreasing" if exact < 0 else "ok"
        records.append(describe_snr(key, CHOSEN, status, (first, second), exact, (float(low), float(high))))
    return pd.DataFrame(records)


def response_size(surrogate: ChosenSurrogate) -> float:
    """Size of y at the design's centre."""
    centre = surrogate.predict(np.zeros((1, len(surrogate.names))))
    return float(np.abs(centre).max())
