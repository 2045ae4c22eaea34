"""What a correction surely changes: the best detectors, and which side is nearer to the truth."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

#: Certainty from which a change, an order or a comparison with the truth is stated.
SURE = 0.95


@dataclass(frozen=True)
class Reevaluation:
    """Tables of a reevaluation.

    Attributes
    ----------
    table : DataFrame
        From `wearscope.evaluation.reevaluation.compare_sides`.
    ranking : DataFrame
        From `wearscope.evaluation.reevaluation.compare_ranking`.
    models : DataFrame
        ``side``, ``drawn``, ``left_out``, ``first_reason``.
    assumed : tuple of str
        What was carried over to the model after, e.g. ``wear at axis_1``.
    names : mapping of str to str
        What factors and detectors are called, e.g. ``temperature`` for ``w3``; by their codes where left out.
    bounds : tuple of str
        Detectors that are told the simulator's law: never the best ones.
    """

    table: pd.DataFrame
    ranking: pd.DataFrame
    models: pd.DataFrame
    assumed: tuple[str, ...] = ()
    names: Mapping[str, str] = field(default_factory=dict)
    bounds: tuple[str, ...] = ()

    @property
    def told(self) -> pd.DataFrame:
        """Rows whose answers are not withheld."""
        return self.table[~self.table["withheld"]]

    @property
    def has_truth(self) -> bool:
        """Whether the truth could be simulated."""
        return bool(np.isfinite(self.table["truth"].to_numpy(dtype=float)).any())

    def cells(self) -> Iterator[tuple[str, int, pd.DataFrame]]:
        """Test-cycle, axis and rows of every place where detectors are compared."""
        for (cycle, axis), rows in self.table.groupby(["cycle", "axis"], sort=True):
            yield str(cycle), int(axis), rows


def judge_detector(rows: pd.DataFrame) -> tuple[list[str], str]:
    """Which of a detector's SNR, rank and scope surely moved towards or away from the truth, and the verdict.

    Returns
    -------
    what : list of str
        ``SNR``, ``rank``, ``scope``: those that the verdict rests on.
    verdict : str
        ``nearer`` or ``farther`` where all of these agree, ``mixed`` where they differ, ``not certain``
        without any.
    """
    signs: dict[str, set[int]] = {}
    for row in rows[rows["question"] != "coefficient"].itertuples():
        if row.p_nearer >= SURE or row.p_nearer <= 1.0 - SURE:
            name = {"snr": "SNR"}.get(str(row.question), str(row.question))
            signs.setdefault(name, set()).add(1 if row.p_nearer >= SURE else -1)
    found = set().union(*signs.values()) if signs else set()
    verdict = {frozenset({1}): "nearer", frozenset({-1}): "farther", frozenset(): "not certain"}
    return list(signs), verdict.get(frozenset(found), "mixed")


def settled_orders(one: Reevaluation, side: str) -> set[tuple[str, int, str, str]]:
    """Test-cycle, axis and two detectors, where the first surely outranks the second."""
    rows = one.ranking[one.ranking[side] >= SURE]
    away = {(row.cycle, row.axis, row.fda) for row in one.table[one.table["withheld"]].itertuples()}
    return {
        (str(row.cycle), int(row.axis), str(row.fda), str(row.over))
        for row in rows.itertuples()
        if away.isdisjoint({(row.cycle, row.axis, row.fda), (row.cycle, row.axis, row.over)})
    }


def best_detectors(one: Reevaluation, side: str) -> dict[tuple[str, int], list[str]]:
    """Detectors by test-cycle and axis that no other one outranks for sure, best first."""
    best = {}
    orders = [order for order in settled_orders(one, side) if order[2] not in one.bounds]
    beaten = {(cycle, axis, over) for cycle, axis, _, over in orders}
    for cycle, axis, rows in one.cells():
        snr = rows[
            ~rows["withheld"] & (rows["question"] == "snr") & np.isfinite(rows[side].to_numpy(dtype=float))
        ]
        order = snr.sort_values(side, ascending=False, kind="stable")["fda"]
        best[cycle, axis] = [
            str(fda) for fda in order if (cycle, axis, fda) not in beaten and fda not in one.bounds
        ]
    return best
