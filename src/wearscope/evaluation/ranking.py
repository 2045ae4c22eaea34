"""Ranks detectors by their median SNR, and recommends one.

A ranking states the uncertainty that comes from the choice of cells. A recommendation states how often it is
repeated on resampled cells.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from scipy import special

from wearscope.designs.kinds import generator_for
from wearscope.errors import InputError
from wearscope.evaluation.grouping import (
    CELL_OF_DETECTOR,
    FEWEST,
    Array,
    bootstrap_indices,
    central_interval,
    check_group,
    nan_median,
)
from wearscope.evaluation.scope import choose_method, count_scope
from wearscope.surrogates.fitting import CELL, cell_name

#: Largest number of values of a block of resamplings, which bounds the memory.
_BLOCK = 1_000_000


def rank_deployable(
    table: pd.DataFrame, bounds: Collection[str] = (), by: Sequence[str] = ("fda",), **options: Any
) -> pd.DataFrame:
    """Rank the detectors that a plant can use by `rank_by_median`; upper bounds come last, without a rank.

    Parameters
    ----------
    table : DataFrame
        One row for each cell.
    bounds : collection of str
        Upper bounds: detectors that know the simulator's friction law.
    by, **options
        As in `rank_by_median`. Where `by` does not contain ``fda``, upper bounds are left out of the groups.
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
    """Rank groups of cells by their median, with intervals for the uncertainty from the choice of cells.

    The combinations of the other design parameters are resampled, each for all groups at once, so that
    differences between groups are paired. Where a group has values in fewer than `FEWEST` combinations,
    resampling tells nothing. Then the intervals of the single cells decide: the interval of a group goes from
    the median of their lower ends to the median of their upper ends, and a group without intervals is tied
    with every other.

    Parameters
    ----------
    table : DataFrame
        One row for each cell.
    value : str
        Column to rank by, larger is better; NaN rows are left out and counted.
    by : sequence of str
        Design parameters that form the groups.
    draws : int
        Bootstrap draws.
    seed : int
    level : float
        Level of the intervals.

    Returns
    -------
    DataFrame
        Best first: the group columns, ``n``, ``n_nan``, ``median``, ``median_low``, ``median_high``,
        ``rank`` (1 is best), ``rank_low``, ``rank_high`` (interval), ``tied_with`` (groups whose median
        does not differ significantly, or whose interval overlaps), ``interval_from``: ``choice of cells`` or
        ``each cell``.

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
    # Drawn in blocks: all draws at once would need the memory of the values times the number of draws.
    block = max(1, _BLOCK // values.size)
    sizes = (min(block, draws - begin) for begin in range(0, draws, block))
    boot = np.concatenate([nan_median(values[bootstrap_indices(len(values), n, stream)]) for n in sizes])
    tail = 0.5 - level / 2
    order = np.argsort(-np.where(np.isnan(median), -np.inf, median), kind="stable")
    filled = np.where(np.isnan(boot), -np.inf, boot)
    ranks = 1 + np.sum(filled[:, None, :] > filled[:, :, None], axis=2)  # equal values share the better rank
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
        best, worst = np.quantile(ranks[:, k], [tail, 1 - tail], method="nearest")
        interval, places = central_interval(boot[:, k], level), (position + 1, int(best), int(worst))
        record = _describe_group(values[:, k], median[k], interval, places, tied[k])
        records.append({**dict(zip(by, keys[k], strict=True)), **record, "interval_from": "choice of cells"})
    return pd.DataFrame(records)


def _rank_few(values: Array, low: Array, high: Array, keys: list[tuple], by: Sequence[str]) -> pd.DataFrame:
    """Rank few cells (N, G) by their own intervals; a group without an interval is tied with every other."""
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
    """Return a group's columns: counts of its cells' values (N,), median, rank and their intervals."""
    return {
        "n": int(np.sum(~np.isnan(values))),
        "n_nan": int(np.sum(np.isnan(values))),
        "median": float(median),
        "median_low": float(interval[0]),
        "median_high": float(interval[1]),
        **dict(zip(("rank", "rank_low", "rank_high"), places, strict=True)),
        "tied_with": ", ".join(tied),
    }


#: Number of times that the choice of a detector is repeated on resampled cells.
RESAMPLINGS = 20
#: A recommendation counts as settled where at least this many repetitions choose the same detector.
SETTLED = 18


@dataclass(frozen=True)
class Recommendation:
    """The detector to use.

    Attributes
    ----------
    detector : str
        Empty where none may be recommended.
    tied_with : list of str
        Detectors whose SNR does not differ significantly from that of the recommended one.
    agree : int
        Number of the `RESAMPLINGS` repetitions that choose this detector.
    cells, cells_first : int
        Number of combinations of robot, test-cycle and axis, and of those in which the detector has the
        largest SNR of all that may be recommended.
    """

    detector: str
    tied_with: list[str]
    agree: int = 0
    cells: int = 0
    cells_first: int = 0


def pick_detector(
    ranking: pd.DataFrame, reach: pd.Series, withheld: Collection[str] = ()
) -> tuple[str, list[str]]:
    """Pick the detector with the widest scope among the one with the best median SNR and those tied with it.

    Parameters
    ----------
    ranking : DataFrame
        From `wearscope.evaluation.ranking.rank_deployable`; a detector without a rank is never picked.
    reach : Series
        By detector, the share of the scope's grid on which it surely meets the requirement.
    withheld : collection of str

    Returns
    -------
    detector : str
        Empty where no detector with a positive median SNR is left.
    tied_with : list of str
    """
    kept = ranking[ranking["rank"].notna() & ~ranking["fda"].isin(list(withheld)) & (ranking["median"] > 0)]
    if kept.empty:
        return "", []
    best = kept.iloc[0]
    tied = [name for name in str(best["tied_with"]).split(", ") if name in set(kept["fda"])]
    candidates = [str(best["fda"]), *tied]
    chosen = max(candidates, key=lambda name: (float(reach.get(name, 0.0)), -candidates.index(name)))
    return chosen, sorted(set(candidates) - {chosen})


def reach_table(scope: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Return the share of the scope's grid on which each cell surely meets the requirement.

    The exact method is used where the table has it, and the estimates alone where it has no confidence. The
    columns are those of `CELL` and ``reach``.
    """
    parts = []
    for part in scope:
        counts = count_scope(choose_method(part), by=CELL)
        sure = counts["sure" if counts["known"].any() else "passes"] / counts["cells"]
        parts.append(counts[CELL].assign(reach=sure).groupby(CELL, sort=True)["reach"].mean().reset_index())
    return pd.concat(parts, ignore_index=True)


def recommend(
    snr: pd.DataFrame,
    reach: pd.DataFrame,
    upper: Collection[str] = (),
    withheld: Collection[str] = (),
    again: Callable[[np.random.Generator], Collection[str]] | None = None,
    seed: int = 0,
) -> tuple[Recommendation, pd.DataFrame]:
    """Recommend the detector that is chosen most often when the choice is repeated on resampled data.

    A repetition draws every cell's SNR anew within its interval. It resamples the combinations of robot,
    test-cycle and axis where there are at least `FEWEST`. It also decides again which detectors are withheld.

    Parameters
    ----------
    snr : DataFrame
        One row for each cell: ``snr_exact``, ``snr_low``, ``snr_high``.
    reach : DataFrame
        From `reach_table`.
    upper, withheld : collection of str
    again : callable, optional
        Returns the withheld detectors for a repetition, given a random generator.
    seed : int

    Returns
    -------
    recommendation : Recommendation
    ranking : DataFrame
        Ranking of all cells, without resampling.
    """
    ranking = rank_deployable(snr, upper, seed=seed)
    first, tied = pick_detector(ranking, reach.groupby("fda")["reach"].mean(), withheld)
    stream = generator_for(seed, "recommendation")
    found: Counter[str] = Counter()
    for _ in range(RESAMPLINGS):
        rows, reached = _resample(snr, reach, stream)
        away = again(stream) if again is not None else withheld
        drawn = rank_deployable(rows, upper, seed=seed, draws=200)
        found[pick_detector(drawn, reached.groupby("fda")["reach"].mean(), away)[0]] += 1
    detector = max(found, key=lambda name: (found[name], name == first))
    if detector != first:
        tied = sorted({*tied, first} - {detector, ""})
    free = snr[~snr["fda"].isin([*upper, *withheld]) & snr["snr_exact"].notna()]
    best = free.sort_values("snr_exact").groupby(CELL_OF_DETECTOR)["fda"].last()
    chosen = Recommendation(detector, tied, found[detector], len(best), int((best == detector).sum()))
    return chosen, ranking


def _resample(
    snr: pd.DataFrame, reach: pd.DataFrame, stream: np.random.Generator
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Resample both tables: SNR within its intervals, and combinations where there are enough."""
    columns = ["snr_exact", "snr_low", "snr_high"]
    rows = snr.reindex(columns=list(dict.fromkeys([*snr.columns, *columns])))
    half = ((rows["snr_high"] - rows["snr_low"]) / 2).fillna(0.0)
    moved = half / special.ndtri(0.975) * stream.standard_normal(len(rows))
    rows[columns] = rows[columns].add(moved, axis=0)
    units = snr[CELL_OF_DETECTOR].drop_duplicates()
    if len(units) < FEWEST:
        return rows, reach
    drawn = units.iloc[bootstrap_indices(len(units), 1, stream)[0]].assign(copy=range(len(units)))
    again = [drawn.merge(table, on=CELL_OF_DETECTOR) for table in (rows, reach)]
    named = [one.assign(cycle=one["cycle"].astype(str) + "#" + one["copy"].astype(str)) for one in again]
    return named[0], named[1]
