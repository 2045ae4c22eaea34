"""The page of a reevaluation: what the correction changes, and whether it is truer."""

import pandas as pd
from markupsafe import Markup

from wearscope.evaluation.certain_changes import SURE, Reevaluation, judge_detector
from wearscope.reporting.charts.sides import chart_sides, side_table
from wearscope.reporting.labels import count_text, join_words, name_term, with_unit, words
from wearscope.reporting.page import (
    Section,
    badge,
    embed_chart,
    interval_text,
    render_page,
    render_part,
    render_table,
)
from wearscope.reporting.reevaluation import tell_best, tell_withheld, truth_sentences
from wearscope.reporting.strips import reevaluation_strip

_KINDS = {"nearer": "good", "farther": "bad", "mixed": "unsure", "not certain": "neutral"}


def render_reevaluation(one: Reevaluation, chosen: pd.DataFrame) -> str:
    """Page of a reevaluation.

    Parameters
    ----------
    one : Reevaluation
    chosen : DataFrame
        Chosen surrogates of all sides.
    """
    robot = str(one.table["robot"].iloc[0])
    sections = [
        Section("Summary", _summarise(one), "summary"),
        Section("Detector by detector", _detectors(one), "detectors"),
        Section("Which factors matter", _question(one, "coefficient"), "q1"),
        Section("Which detector is best", _ranks(one), "q2"),
        Section("Where it works", _question(one, "scope"), "q3"),
        Section("What it rests on", _basis(one, chosen), "basis"),
    ]
    return render_page(
        f"What the correction of {robot} changes",
        sections,
        "The study's questions for the model before and after its correction",
        "Made by wearscope from reevaluation.parquet.",
        tables={"sides": snr_sides(one)},
        strip=reevaluation_strip(one),
    )


def snr_sides(one: Reevaluation) -> pd.DataFrame:
    """SNR of every detector on each side, for the chart."""
    rows = one.table[one.table["question"] == "snr"].sort_values(["cycle", "axis", "fda"], kind="stable")
    places = zip(rows["fda"], rows["axis"], rows["cycle"], strict=True)
    rows = rows.assign(thing=[f"{fda}, axis {axis}, {words(cycle)}" for fda, axis, cycle in places])
    parts = {
        side: rows.rename(columns={f"{side}{end}": f"snr{end}" for end in ("", "_low", "_high")})
        for side in list_sides(one)
    }
    return side_table(parts, "thing", "snr")


def list_sides(one: Reevaluation) -> list[str]:
    """Sides that are compared; the truth where it is known."""
    return ["before", "after", *(["truth"] if one.has_truth else [])]


def draw_change(one: Reevaluation) -> Markup:
    """Chart of every detector's SNR on each side; the page must have `snr_sides`."""
    return embed_chart(
        chart_sides(
            list_sides(one),
            "Signal-to-noise ratio before and after",
            "signal-to-noise ratio",
            "cell",
            "With 95 % intervals, over the models that the data allow.",
        )
    )


def _summarise(one: Reevaluation) -> Markup:
    """Which answers change, and what is nearer to the truth."""
    assumed = (
        f"Assumed on every side, as no data show it: {join_words(one.assumed)}, carried over and scaled to "
        "the joint's own friction."
    )
    sentences = render_part(listed=[tell_best(one), *tell_withheld(one), *truth_sentences(one)])
    return sentences + render_part(notes=[assumed] if one.assumed else [], parts=[draw_change(one)])


def _value(row: object, side: str) -> str:
    return interval_text(*(getattr(row, name) for name in (side, f"{side}_low", f"{side}_high")))


def _detectors(one: Reevaluation) -> Markup:
    sides = list_sides(one)
    records = []
    for (cycle, axis, fda), rows in one.table.groupby(["cycle", "axis", "fda"], sort=True):
        snr = next(rows[rows["question"] == "snr"].itertuples())
        what, verdict = judge_detector(rows)
        record: dict[str, object] = {"axis": axis, "test-cycle": words(cycle)}
        record["detector"] = one.names.get(fda, fda)
        if one.has_truth:
            text = f"{verdict}: {join_words(what)}" if what else verdict
            record["after the correction"] = badge(text, _KINDS[verdict])
        record |= {f"SNR {side}": _value(snr, side) for side in sides}
        records.append(record)
    note = "SNR with its 95 % interval."
    if one.has_truth:
        note += " After is nearer to the truth, or farther from it, in what stands after the colon."
    else:
        note += " The truth of a real machine cannot be simulated, so no side is called nearer to it."
    return render_table(records, note)


def _question(one: Reevaluation, question: str) -> Markup:
    """What surely changed; a sentence where nothing did."""
    sides = list_sides(one)
    own = one.table[one.table["question"] == question]
    rows = own[own["p_changed"] >= SURE]
    if rows.empty:
        return render_part(
            told=[("", f"None of {len(own)} answers changed with {100 * SURE:g} % certainty.")]
        )
    records = []
    for row in rows.sort_values("p_changed", ascending=False, kind="stable").itertuples():
        record: dict[str, object] = {"axis": row.axis, "test-cycle": words(row.cycle), "detector": row.fda}
        if question == "scope":
            record["factor"] = with_unit(one.names.get(row.about, row.about), row.unit)
            record["change of wear"] = row.delta
        else:
            record["term"] = name_term(str(row.about), one.names)
        records.append(record | {side: _value(row, side) for side in sides})
    note = {
        "scope": "Largest standard deviation of the factor at which the change of wear is still detected, in "
        "natural units; the grid's end where it is reached.",
        "coefficient": "Coefficient over that of wear; beyond ±1 the factor outweighs wear.",
    }[question]
    return render_table(records, f"{note} What changed with {100 * SURE:g} % certainty, of {len(own)}.")


def _ranks(one: Reevaluation) -> Markup:
    shown = one.ranking.rename(columns={"fda": "detector", "over": "outranks", "cycle": "test-cycle"})
    shown = shown[shown["detector"] < shown["outranks"]].drop(columns="robot")
    shown["test-cycle"] = shown["test-cycle"].map(words)
    if not one.has_truth:
        shown = shown.drop(columns="truth")
    return render_table(shown, "Probability that the first detector has the higher SNR, by side.")


def _basis(one: Reevaluation, chosen: pd.DataFrame) -> Markup:
    sentences = []
    for row in one.models.itertuples():
        if row.drawn or row.left_out:
            text = f"{row.side}: {count_text(int(row.drawn), 'model')} drawn from what the data leave open"
            if row.left_out:
                text += f", {row.left_out} more left out (first: {row.first_reason.rstrip('.')})"
            sentences.append(text + ".")
        else:
            sentences.append(f"{row.side}: the model alone; nothing is known of its uncertainty.")
    columns = ["robot", "axis", "fda", "kind", "fit", "state", "n_points"]
    shown = chosen[columns].rename(columns={"robot": "side", "fda": "detector", "n_points": "points"})
    table = render_table(shown, "Surrogates, with their fit [%] on checking points.")
    return render_part(listed=sentences) + table
