"""Ranking detectors, or groups of cells, by their median SNR, with what the choice of cells leaves open."""

from collections.abc import Collection, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from wearscope.designs.kinds import generator_for
from wearscope.errors import InputError
from wearscope.evaluation.grouping import bootstrap_indices, check_group
from wearscope.evaluation.paired_estimates import FEWEST, Array, nan_median
from wearscope.surrogates.fitting import CELL, cell_name

#: Largest number of values that one block of resamplings holds in memory.
_BLOCK = 1_000_000


def rank_deployable(
    table: pd.DataFrame, bounds: Collection[str] = (), by: Sequence[str] = ("fda",), **options: Any
) -> pd.DataFrame:
    """Rank the detectors that a plant can use by `rank_by_median`; upper bounds come last, without a rank.

    Parameters
    ----------
    table : DataFrame
        One row a cell.
    bounds : collection of str
        Detectors that are told the simulator's law.
    by, **options
        As in `rank_by_median`. Groups of several detectors leave upper bounds out.
    """
    apart = table["fda"].isin(list(bounds))
    if not apart.any():
        return rank_by_median(table, by=by, **options)
    kept = [] if apart.all() else [rank_by_median(table[~apart], by=by, **options)]
    if "fda" not in by:
        if not kept:
            raise InputError("ranking: every detector is told the simulator's law; add one that is not.")
        return kept[0]
    above = rank_by_median(table[apart], by=by, **options)
    above = above.assign(rank=np.nan, rank_low=np.nan, rank_high=np.nan, tied_with="")
    return pd.concat([*kept, above], ignore_index=True)


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
    them at once), so that differences between groups are paired. Where a group has values in fewer than
    `FEWEST` of them, resampling says nothing: there the cells' own intervals decide. A group's interval is
    the medians of its cells' ends; a group without intervals is tied with every other.

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
    if len(values) < FEWEST or np.any((held > 0) & (held < FEWEST)):
        low, high = (
            table.pivot(index=rest, columns=by, values=name).reindex_like(wide).to_numpy(dtype=float)
            if name in table.columns
            else np.full_like(values, np.nan)
            for name in ("snr_low", "snr_high")
        )
        return _rank_few(values, low, high, keys, by)
    stream = generator_for(seed, "rank", value, *by)
    median = nan_median(values)
    # Drawn in blocks: all at once they would take draws times the memory of the values.
    block = max(1, _BLOCK // values.size)
    sizes = (min(block, draws - begin) for begin in range(0, draws, block))
    boot = np.concatenate([nan_median(values[bootstrap_indices(len(values), n, stream)]) for n in sizes])
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
        interval, places = (low, high), (position + 1, int(best), int(worst))
        record = _describe_group(values[:, k], median[k], interval, places, tied[k])
        records.append({**dict(zip(by, keys[k], strict=True)), **record, "interval_from": "choice of cells"})
    return pd.DataFrame(records)


def _rank_few(values: Array, low: Array, high: Array, keys: list[tuple], by: Sequence[str]) -> pd.DataFrame:
    """Ranking of few cells (N, G) by their own intervals; a group without one is tied with every other."""
    median, low, high = (nan_median(one) for one in (values, low, high))
    known = np.isfinite(median)
    bottom, top = np.where(np.isfinite(low), low, -np.inf), np.where(np.isfinite(high), high, np.inf)
    records = []
    for position, k in enumerate(np.argsort(-np.where(known, median, -np.inf), kind="stable")):
        others = [j for j in range(len(keys)) if j != k and known[j]]
        above = [j for j in others if bottom[j] > top[k]]
        below = [j for j in others if top[j] < bottom[k]]
        tied = [cell_name(keys[j]) for j in others if j not in above and j not in below] if known[k] else []
        best, worst = (
            (1 + len(above), len(others) + 1 - len(below)) if known[k] else (position + 1, len(keys))
        )
        places = (position + 1, best, worst)
        record = _describe_group(values[:, k], median[k], (low[k], high[k]), places, tied)
        records.append({**dict(zip(by, keys[k], strict=True)), **record, "interval_from": "each cell"})
    return pd.DataFrame(records)


def _describe_group(
    values: Array,
    median: float,
    interval: tuple[float, float],
    places: tuple[int, int, int],
    tied: Sequence[str],
) -> dict[str, Any]:
    """A group's columns from its cells' values (N,), its rank and the interval of the rank."""
    return {
        "n": int(np.sum(~np.isnan(values))),
        "n_nan": int(np.sum(np.isnan(values))),
        "median": float(median),
        "median_low": float(interval[0]),
        "median_high": float(interval[1]),
        **dict(zip(("rank", "rank_low", "rank_high"), places, strict=True)),
        "tied_with": ", ".join(tied),
    }
