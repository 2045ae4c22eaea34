"""Which detector to recommend, and how often a resampled study would recommend the same."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import special

from wearscope.designs.kinds import generator_for
from wearscope.evaluation.grouping import bootstrap_indices
from wearscope.evaluation.paired_estimates import CELL_OF_DETECTOR, FEWEST
from wearscope.evaluation.ranking import rank_deployable
from wearscope.evaluation.scope import count_scope
from wearscope.surrogates.fitting import CELL

#: Resamplings: how often the choice of a detector is repeated on resampled cells.
RESAMPLINGS = 20
#: Resamplings in which the same detector must be chosen for the recommendation to count as settled.
SETTLED = 18


@dataclass(frozen=True)
class Recommendation:
    """The detector to use.

    Attributes
    ----------
    detector : str
        Empty where none may be recommended.
    tied_with : list of str
        Detectors that the SNR does not tell apart from it.
    agree : int
        Of `RESAMPLINGS`, those in which it comes out.
    cells, cells_first : int
        Combinations of robot, test-cycle and axis, and those in which it has the largest SNR of all that may
        be recommended.
    """

    detector: str
    tied_with: list[str]
    agree: int = 0
    cells: int = 0
    cells_first: int = 0


def pick_detector(
    ranking: pd.DataFrame, reach: pd.Series, withheld: Collection[str] = ()
) -> tuple[str, list[str]]:
    """Of the detectors with the best median SNR and those not told apart from it, the one that reaches most.

    Parameters
    ----------
    ranking : DataFrame
        From `wearscope.evaluation.ranking.rank_deployable`; what has no rank is never picked.
    reach : Series
        Share of the scope's grid on which each detector surely works, by detector.
    withheld : collection of str

    Returns
    -------
    detector, tied_with
        An empty name where none is left whose median SNR is positive.
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
    """Share of the grid on which each cell surely meets the requirement: `CELL` and ``reach``.

    By the exact method where it is there; by the estimates where no confidence was asked.
    """
    parts = []
    for part in scope:
        counts = count_scope(choose_method(part), by=CELL)
        sure = counts["sure" if counts["known"].any() else "passes"] / counts["cells"]
        parts.append(counts[CELL].assign(reach=sure).groupby(CELL, sort=True)["reach"].mean().reset_index())
    return pd.concat(parts, ignore_index=True)


def choose_method(scope: pd.DataFrame) -> pd.DataFrame:
    """Rows of the exact method, or of the other method where the study did not ask for the exact one."""
    exact = scope["method"] == "exact"
    return scope[exact] if exact.any() else scope


def recommend(
    snr: pd.DataFrame,
    reach: pd.DataFrame,
    upper: Collection[str] = (),
    withheld: Collection[str] = (),
    again: Callable[[np.random.Generator], Collection[str]] | None = None,
    seed: int = 0,
) -> tuple[Recommendation, pd.DataFrame]:
    """The detector that comes out most often when the choice is made again.

    In each resampling every cell's SNR is drawn anew within its interval; combinations of robot, test-cycle
    and axis are resampled where there are `FEWEST` or more; and what is withheld is decided again.

    Parameters
    ----------
    snr : DataFrame
        One row a cell: ``snr_exact``, ``snr_low``, ``snr_high``.
    reach : DataFrame
        From `reach_table`.
    upper, withheld : collection of str
    again : callable, optional
        The detectors that are withheld in a resampling.
    seed : int

    Returns
    -------
    recommendation : Recommendation
    ranking : DataFrame
        Of all cells, without resampling.
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
    """Both tables resampled: values within their intervals, combinations where there are enough."""
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
