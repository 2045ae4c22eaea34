"""What the correction changes, in words: which detector, what SNR and rank, what scope, and what is truer."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from wearscope.reporting.labels import count_text, join_words, name_term, unit_text, words
from wearscope.reporting.page import format_number, interval_text

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


def answer_sentences(one: Reevaluation) -> list[str]:
    """Which of the three answers change, a sentence for each."""
    return [_relevance(one), _best(one), _snr(one), _scope(one), *_withheld(one)]


def _withheld(one: Reevaluation) -> list[str]:
    rows = one.table[one.table["withheld"]].drop_duplicates(["cycle", "axis", "fda"])
    if rows.empty:
        return []
    cells = [f"{row.fda} on axis {row.axis}" for row in rows.itertuples()]
    return [
        f"Withheld, as its surrogate misses the points that it was checked on: {join_words(cells)}; it is in "
        "no sentence here."
    ]


def truth_sentences(one: Reevaluation) -> list[str]:
    """Detector by detector, whether after is nearer to the truth than before; or that nobody can say."""
    if not one.has_truth:
        return ["Which side is nearer to the truth cannot be said: the real machine's cannot be simulated."]
    nearer: list[str] = []
    farther: list[str] = []
    open_: list[str] = []
    for (axis, fda), rows in one.told.groupby(["axis", "fda"], sort=True):
        what, verdict = judge_detector(rows)
        place = {"nearer": nearer, "farther": farther}.get(verdict, open_)
        place.append(f"{fda} on axis {axis}" + (f" ({join_words(what)})" if what else ""))
    sentences = []
    if nearer:
        sentences.append(f"After is nearer to the truth than before, for {join_words(nearer)}.")
    if farther:
        sentences.append(f"After is farther from the truth than before, for {join_words(farther)}.")
    if open_:
        sentences.append(f"Neither is nearer with {100 * SURE:g} % certainty for {join_words(open_)}.")
    return sentences


def count_truth(one: Reevaluation) -> str:
    """For how many detectors and axes after is nearer to the truth, or that nobody can say."""
    if not one.has_truth:
        return truth_sentences(one)[0]
    verdicts = [judge_detector(rows)[1] for _, rows in one.told.groupby(["axis", "fda"], sort=True)]
    cells = count_text(len(verdicts), "detector and axis", "detectors and axes")
    nearer, farther = (verdicts.count(verdict) for verdict in ("nearer", "farther"))
    return f"The corrected model is nearer to the truth for {nearer or 'none'} of {cells}, farther for {farther or 'none'}."


def judge_detector(rows: pd.DataFrame) -> tuple[list[str], str]:
    """What of a detector's SNR, rank and scope is told apart from the truth's side, and the verdict.

    Returns
    -------
    what : list of str
        ``SNR``, ``rank``, ``scope``: on which the verdict rests.
    verdict : str
        ``nearer`` or ``farther`` where all that is told says so, ``mixed``, or ``not told`` where nothing is.
    """
    signs: dict[str, set[int]] = {}
    for row in rows[rows["question"] != "coefficient"].itertuples():
        if row.p_nearer >= SURE or row.p_nearer <= 1.0 - SURE:
            name = {"snr": "SNR"}.get(str(row.question), str(row.question))
            signs.setdefault(name, set()).add(1 if row.p_nearer >= SURE else -1)
    found = set().union(*signs.values()) if signs else set()
    verdict = {frozenset({1}): "nearer", frozenset({-1}): "farther", frozenset(): "not told"}
    return list(signs), verdict.get(frozenset(found), "mixed")


def settled_orders(one: Reevaluation, side: str) -> set[tuple[str, int, str, str]]:
    """Test-cycle, axis and pairs of detectors of which the first outranks the second for sure."""
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


def _relevance(one: Reevaluation) -> str:
    asked = one.told[one.told["question"] == "coefficient"]
    rows = asked[asked["p_changed"] >= SURE]
    crossed = rows[(rows["before"].abs() > 1.0) != (rows["after"].abs() > 1.0)]
    if crossed.empty:
        return (
            "Which factors matter: the same ones. No factor outweighs wear on one side alone, with "
            f"{100 * SURE:g} % certainty; {len(rows)} of {count_text(len(asked), 'coefficient')} changed."
        )
    parts = [
        f"{name_term(str(row.about), one.names)} for {row.fda} on axis {row.axis} "
        f"({format_number(row.before)} to {format_number(row.after)} of wear's)"
        for row in crossed.itertuples()
    ]
    return f"Which factors matter: it changes for {join_words(parts)}."


def tell_headline(one: Reevaluation) -> str:
    """Whether the best detector and the SNR change, in two short sentences."""
    changed = _compare_best(one)[0]
    best = f"changes {'; '.join(changed)}" if changed else "stays the same"
    rows = one.told[(one.told["question"] == "snr") & (one.told["p_changed"] >= SURE)]
    cells = [f"{join_words(list(own['fda'].unique()))} on axis {axis}" for axis, own in rows.groupby("axis")]
    return f"The best detector {best}. The signal-to-noise ratio changes for {join_words(cells) or 'none'}."


def _compare_best(one: Reevaluation) -> tuple[list[str], list[str]]:
    """Where the best detectors change, with both sides, and the axes where they do not."""
    before, after = (best_detectors(one, side) for side in ("before", "after"))
    parts, same = [], []
    for (cycle, axis), names in after.items():
        was, names = ([one.names.get(fda, fda) for fda in side] for side in (before[cycle, axis], names))
        if set(was) == set(names):
            same.append(f"axis {axis}")
        else:
            parts.append(
                f"on axis {axis} ({words(cycle)}): {join_words(was, 'or') or 'none'} before, "
                f"{join_words(names, 'or') or 'none'} after"
            )
    return parts, same


def _best(one: Reevaluation) -> str:
    parts, same = _compare_best(one)
    text = "Which detector is best: "
    text += f"it changes {'; '.join(parts)}" if parts else "the same on both sides"
    if parts and same:
        text += f"; the same on {join_words(same)}"
    first, second = (settled_orders(one, side) for side in ("before", "after"))
    turned = [(c, a, x, y) for c, a, x, y in second if (c, a, y, x) in first]
    text += (
        f". Of the detectors' pairs, {len(first)} are in a sure order before and {len(second)} after; "
        f"{len(turned)} turned round."
    )
    return text


def _snr(one: Reevaluation) -> str:
    rows = one.told[one.told["question"] == "snr"]
    changed = rows[rows["p_changed"] >= SURE]
    if changed.empty:
        return f"What SNR: no change that is {100 * SURE:g} % certain in {count_text(len(rows), 'cell')}."
    parts = [
        f"{row.fda} on axis {row.axis}: {interval_text(row.before, row.before_low, row.before_high)} before, "
        f"{interval_text(row.after, row.after_low, row.after_high)} after"
        for row in changed.itertuples()
    ]
    return f"What SNR: it changes for {'; '.join(parts)}."


def _scope(one: Reevaluation) -> str:
    rows = one.told[one.told["question"] == "scope"]
    changed = rows[rows["p_changed"] >= SURE]
    if changed.empty:
        return (
            f"What scope: no change that is {100 * SURE:g} % certain in {count_text(len(rows), 'tolerance')}."
        )
    parts = [
        f"{row.fda} on axis {row.axis} tolerates σ of {one.names.get(row.about, row.about)} up to "
        f"{format_number(row.before)} {unit_text(row.unit)} before, {format_number(row.after)} "
        f"{unit_text(row.unit)} after, at a change of wear of {format_number(row.delta)}"
        for row in changed.itertuples()
    ]
    return f"What scope: it changes where {'; '.join(parts)}."
