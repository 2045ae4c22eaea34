"""What a correction changes: coefficients, SNR, ranks and scope before, after and in truth.

Sure changes are the best detectors, and which side is nearer to the truth.
"""

from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from itertools import permutations
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import binom

from wearscope.designs.factors import FAULT, Factor
from wearscope.evaluation.sides import Answers
from wearscope.surrogates.fitting import CELL

Array = NDArray[np.float64]
SIDES = ("before", "after", "truth")
QUESTIONS = ("coefficient", "snr", "rank", "scope")
LEVEL = 0.95


def withheld_cells(chosen: pd.DataFrame) -> set[tuple[str, int, str]]:
    """Cells (test-cycle, axis, detector) whose surrogates miss their checking points too often.

    Where fewer lie in their 95 % intervals than chance allows, at 5 % over all cells and sides together.

    Parameters
    ----------
    chosen : DataFrame
        From `wearscope.surrogates.chosen.choose_surrogates`, of all sides.
    """
    inside = np.round(chosen["inside"] * chosen["n_checking"])
    chance = binom.cdf(inside, chosen["n_checking"], LEVEL)
    rows = chosen[(chosen["inside"].notna()) & (chance < (1.0 - LEVEL) / len(chosen))]
    return {(str(row.cycle), int(row.axis), str(row.fda)) for row in rows.itertuples()}


def compare_sides(
    answers: Mapping[str, Answers],
    robot: str,
    factors: Sequence[Factor],
    withheld: AbstractSet[tuple[str, int, str]] = frozenset(),
) -> pd.DataFrame:
    """Answers before and after, and where it is known the truth, side by side.

    Parameters
    ----------
    answers : mapping of str to Answers
        ``before``, ``after`` and, where it can be simulated, ``truth``.
    robot : str
        What tables call the robot.
    factors : sequence of Factor
    withheld : set
        Of `withheld_cells`.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``withheld``, ``question``, ``about`` (the term or the
        factor), ``delta`` (change of the fault, natural; NaN where there is none), ``unit``; ``before``,
        ``after``, ``truth``, each with ``_low`` and ``_high`` (95 %); ``p_changed``, how much more probable
        one direction of the change is than the other: 0 where nothing tells, 1 where it is sure;
        ``p_nearer``, the probability that after is nearer to the truth than before (ties count half), NaN
        without a truth. A coefficient is over that of the fault (8); an SNR (11) is that of single runs,
        their noise included; a rank is by SNR among the detectors of the cell's test-cycle and axis; a scope
        is the largest standard deviation that the factor may have, natural.
    """
    known = {factor.name: factor for factor in factors}
    shared = [key for key in answers["before"].value if key in answers["after"].value]
    records = []
    for key in shared:
        cycle, axis, fda, question, about, delta = key
        factor = known.get(about) if question == "scope" else None
        scale = factor.step if factor is not None else 1.0
        row: dict[str, Any] = {
            "robot": robot,
            "cycle": cycle,
            "axis": axis,
            "fda": fda,
            "withheld": (cycle, axis, fda) in withheld,
            "question": question,
            "about": about,
            "delta": delta * known[FAULT].step if delta else np.nan,
            "unit": factor.unit if factor is not None else "1",
        }
        for side in SIDES:
            value, drawn = np.nan, np.full(1, np.nan)
            if side in answers and key in answers[side].value:
                value, drawn = answers[side].value[key], answers[side].drawn.get(key, drawn)
            row[side] = scale * value
            row[f"{side}_low"], row[f"{side}_high"] = scale * _interval(drawn)
        before, after = (answers[side].drawn.get(key) for side in SIDES[:2])
        truth = answers["truth"].drawn.get(key) if "truth" in answers else None
        row["p_changed"], row["p_nearer"] = _probabilities(before, after, truth)
        records.append(row)
    order = {name: place for place, name in enumerate(QUESTIONS)}
    table = pd.DataFrame(records)
    table["_order"] = table["question"].map(order)
    table = table.sort_values([*CELL, "_order", "about", "delta"], kind="stable", ignore_index=True)
    return table.drop(columns="_order")


def compare_ranking(answers: Mapping[str, Answers], robot: str) -> pd.DataFrame:
    """Probability that one detector has the higher SNR, for every pair, test-cycle and axis.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``over`` (the other detector), and by side the probability
        that `fda` outranks it; NaN where a side has no SNR of either.
    """
    records = []
    cells = dict.fromkeys(key[:2] for key in answers["before"].value)
    for cycle, axis in cells:
        detectors = [
            key[2] for key in answers["before"].value if key[:2] == (cycle, axis) and key[3] == "snr"
        ]
        for one, other in permutations(detectors, 2):
            row: dict[str, Any] = {"robot": robot, "cycle": cycle, "axis": axis, "fda": one, "over": other}
            for side in SIDES:
                drawn = answers[side].drawn if side in answers else {}
                pair = [drawn.get((cycle, axis, name, "snr", "", 0.0)) for name in (one, other)]
                row[side] = _probability(*pair)
            records.append(row)
    return pd.DataFrame(records, columns=["robot", "cycle", "axis", "fda", "over", *SIDES])


def _interval(drawn: Array) -> Array:
    good = drawn[np.isfinite(drawn)]
    if good.size == 0:
        return np.full(2, np.nan)
    return np.quantile(good, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])


def _probability(first: Array | None, second: Array | None) -> float:
    """Probability that the first is larger; ties count half."""
    if first is None or second is None:
        return np.nan
    size = min(len(first), len(second))
    difference = first[:size] - second[:size]
    good = difference[~np.isnan(difference)]
    return float(np.mean((good > 0) + 0.5 * (good == 0))) if good.size else np.nan


def _probabilities(before: Array | None, after: Array | None, truth: Array | None) -> tuple[float, float]:
    """Certainty of the change's direction; probability that after is nearer to the truth."""
    up = _probability(after, before)
    changed = abs(2.0 * up - 1.0)
    if before is None or after is None or truth is None:
        return changed, np.nan
    size = min(len(before), len(after), len(truth))
    # The sides are drawn independently: draws with the same index have nothing in common.
    far, near = (np.abs(side[:size] - truth[:size]) for side in (before, after))
    return changed, _probability(far, near)


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
