"""The page of a reevaluation: what the correction changes, and whether it is nearer to the truth."""

import pandas as pd
from markupsafe import Markup

from wearscope.evaluation.reevaluation import SURE, Reevaluation, best_detectors, judge_detector
from wearscope.reporting.charts.study import chart_sides, side_table
from wearscope.reporting.labels import join_words, name_term, with_unit, words
from wearscope.reporting.page import (
    Section,
    badge,
    embed_chart,
    interval_text,
    render_page,
    render_part,
    render_table,
    say,
    say_lines,
)
from wearscope.reporting.page_strip import Strip

_WORDS = "reevaluation/words.html"
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
        strip=_strip(one),
    )


def _strip(one: Reevaluation) -> Strip:
    withheld = tell_withheld(one)
    caveat = withheld[0] if withheld else say(_WORDS, "rests", list(_group_assumed(one)))
    action = Markup('See <a href="#detectors">detector by detector</a>, then study the corrected model.')
    kind = "unsure" if withheld or not one.has_truth else "good"
    return Strip(tell_headline(one), kind, count_truth(one), caveat, action)


def snr_sides(one: Reevaluation) -> pd.DataFrame:
    """SNR of every detector on each side, for the chart."""
    rows = one.table[one.table["question"] == "snr"].sort_values(["cycle", "axis", "fda"], kind="stable")
    thing = rows["fda"].replace(dict(one.names)) + ", axis " + rows["axis"].astype(str)
    if rows["cycle"].nunique() > 1:
        thing += ", " + rows["cycle"].map(words)
    rows = rows.assign(thing=thing)
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
    title, caption = "Signal-to-noise ratio", "With 95 % intervals, over the models that the data allow."
    return embed_chart(
        chart_sides(list_sides(one), f"{title} before and after", "signal-to-noise ratio", "cell", caption)
    )


def _summarise(one: Reevaluation) -> Markup:
    """Section on answers that are withheld and on assumptions, with the chart of every SNR."""
    notes = say_lines(_WORDS, "assumed", _group_assumed(one))
    return render_part(notes=notes, parts=[draw_change(one)], listed=tell_withheld(one))


def _group_assumed(one: Reevaluation) -> dict[str, list[str]]:
    """Joints by the effect that was carried over to them."""
    found: dict[str, list[str]] = {}
    for name in one.assumed:
        effect, _, joint = name.partition(" at ")
        found.setdefault(words(effect), []).append(joint)
    return found


def _values(row: object, sides: list[str], name: str = "{}") -> dict[str, str]:
    """Columns with a row's value and interval on each side."""
    return {
        name.format(side): interval_text(*(getattr(row, f"{side}{end}") for end in ("", "_low", "_high")))
        for side in sides
    }


def _detectors(one: Reevaluation) -> Markup:
    records = []
    for (cycle, axis, fda), rows in one.table.groupby(["cycle", "axis", "fda"], sort=True):
        snr = next(rows[rows["question"] == "snr"].itertuples())
        what, verdict = judge_detector(rows)
        record = {"axis": axis, "test-cycle": words(cycle), "detector": one.names.get(fda, fda)}
        if one.has_truth:
            text = f"{verdict}: {join_words(what)}" if what else verdict
            record["after the correction"] = badge(text, _KINDS[verdict])
        records.append(record | _values(snr, list_sides(one), "SNR {}"))
    told = "The truth of a real machine cannot be simulated, so no side is called nearer to it."
    if one.has_truth:
        told = "After is nearer to the truth, or farther from it, in what stands after the colon."
    return render_table(records, f"SNR with its 95 % interval. {told}")


def _question(one: Reevaluation, question: str) -> Markup:
    """Table of a question's answers that surely changed; a sentence where none did."""
    own = one.table[one.table["question"] == question]
    rows = own[own["p_changed"] >= SURE]
    if rows.empty:
        return render_part(told=[f"None of {len(own)} answers changed with {100 * SURE:g} % certainty."])
    records = []
    for row in rows.sort_values("p_changed", ascending=False, kind="stable").itertuples():
        record: dict[str, object] = {
            "axis": row.axis,
            "test-cycle": words(row.cycle),
            "detector": one.names.get(row.fda, row.fda),
        }
        if question == "scope":
            record["factor"] = with_unit(one.names.get(row.about, row.about), row.unit)
            record["change of wear"] = row.delta
        else:
            record["term"] = name_term(str(row.about), one.names)
        records.append(record | _values(row, list_sides(one)))
    note = {
        "scope": "Largest standard deviation of the factor at which the change of wear is still detected, in "
        "natural units; the grid's end where it is reached.",
        "coefficient": "Coefficient over that of wear; beyond ±1 the factor outweighs wear.",
    }[question]
    return render_table(records, f"{note} What changed with {100 * SURE:g} % certainty, of {len(own)}.")


def _ranks(one: Reevaluation) -> Markup:
    shown = one.ranking[one.ranking["fda"] < one.ranking["over"]].drop(columns="robot")
    shown = shown.replace({"fda": dict(one.names), "over": dict(one.names)})
    shown = shown.assign(cycle=shown["cycle"].map(words))
    shown = shown.rename(columns={"fda": "detector", "over": "outranks", "cycle": "test-cycle"})
    shown = shown if one.has_truth else shown.drop(columns="truth")
    return render_table(shown, "Probability that the first detector has the higher SNR, by side.")


def _basis(one: Reevaluation, chosen: pd.DataFrame) -> Markup:
    sentences = [say(_WORDS, "basis", row) for row in one.models.itertuples()]
    columns = "robot|side; axis; fda|detector; kind; fit; state; n_points|points"
    shown = chosen.assign(fda=chosen["fda"].replace(dict(one.names)), kind=chosen["kind"].map(words))
    table = render_table(shown, "Surrogates, with their fit [%] on checking points.", columns=columns)
    return render_part(listed=sentences) + table


def tell_withheld(one: Reevaluation) -> list[Markup]:
    """Detectors whose surrogates miss their checks; [] where there is none."""
    rows = one.table[one.table["withheld"]].drop_duplicates(["cycle", "axis", "fda"])
    cells = [f"{one.names.get(row.fda, row.fda)} on axis {row.axis}" for row in rows.itertuples()]
    return say_lines(_WORDS, "withheld", cells)


def count_truth(one: Reevaluation) -> str:
    """Number of detectors and axes for which the side after is nearer to the truth, if the truth is known."""
    verdicts = [judge_detector(rows)[1] for _, rows in one.told.groupby(["axis", "fda"], sort=True)]
    nearer, farther = (verdicts.count(verdict) for verdict in ("nearer", "farther"))
    return say(_WORDS, "truth", one.has_truth, nearer, farther, len(verdicts)).striptags()


def tell_headline(one: Reevaluation) -> str:
    """Whether the best detector and the SNR change, in two short sentences."""
    rows = one.told[(one.told["question"] == "snr") & (one.told["p_changed"] >= SURE)]
    cells = [
        f"{join_words([one.names.get(fda, fda) for fda in own['fda'].unique()])} on axis {axis}"
        for axis, own in rows.groupby("axis")
    ]
    return say(_WORDS, "headline", *_compare_best(one), cells).striptags()


def _compare_best(one: Reevaluation) -> tuple[list[Markup], bool]:
    """Where the best detector surely changes, and whether everywhere else it surely stays the same."""
    before, after = (best_detectors(one, side) for side in ("before", "after"))
    parts, sure = [], True
    for (cycle, axis), names in after.items():
        was, names = ([one.names.get(fda, fda) for fda in side] for side in (before[cycle, axis], names))
        if set(was).isdisjoint(names) and (was or names):
            parts.append(say(_WORDS, "best", axis, words(cycle), was, names))
        sure = sure and was == names and len(names) < 2
    return parts, sure
