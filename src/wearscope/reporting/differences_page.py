"""The page of two results side by side: studies or loops, what differs first."""

from collections.abc import Mapping
from typing import Any

import pandas as pd
from markupsafe import Markup

from wearscope.reporting.charts.sides import chart_sides, side_table
from wearscope.reporting.labels import count_text, join_words, words
from wearscope.reporting.page import Section, embed_chart, render_page, render_part, render_table
from wearscope.reporting.page_strip import Strip

Names = tuple[str, str]
#: Rows above which a table is folded, and conclusions that are told in sentences.
_LONG, _TOLD = 25, 5
#: What differs, by what the comparison calls it.
_KINDS = (
    ("conclusion", "Conclusions"),
    ("setting", "Settings"),
    ("version", "Versions"),
    ("table", "Tables"),
    ("file", "Files"),
)


def render_study_differences(
    names: Names, rankings: tuple[pd.DataFrame, pd.DataFrame], differences: pd.DataFrame
) -> str:
    """Page of two studies.

    Parameters
    ----------
    names : tuple of str
        What the two are called.
    rankings : tuple of DataFrame
        ``ranking.parquet`` of each; empty where there is none.
    differences : DataFrame
        As `wearscope.archives.comparison.compare_archives` returns it.
    """
    differences = differences[~differences["outcome"].isin(["same bytes", "same values"])]
    sides = {
        name: frame.assign(side=name)[["side", "fda", "median", "median_low", "median_high", "rank"]]
        for name, frame in zip(names, rankings, strict=True)
        if len(frame)
    }
    told = tell_studies(names, rankings, differences)
    sections = [Section("What differs", render_part(listed=told), "summary")]
    kinds = set(differences["what"])
    settings = int((differences["what"] == "setting").sum())
    caveat = "No setting that both record differs."
    if settings:
        caveat = (
            f"{count_text(settings, 'setting')} differ{'s' if settings == 1 else ''} too, and may be why."
        )
    action = next(((kind, title) for kind, title in _KINDS if kind in kinds), ("summary", "What differs"))
    sure = "Every table was compared by its values; settings and versions where both record them."
    strip = Strip(" ".join(told[:2]), "unsure" if kinds else "good", sure, caveat, _link(*action))
    found = {}
    if sides:
        table = pd.concat(sides.values(), ignore_index=True)
        found["sides"] = side_table(sides, "fda", "median")
        chart = chart_sides(
            names,
            "Median SNR of each detector",
            "median signal-to-noise ratio",
            "detector",
            "Bars: 95 % intervals.",
        )
        shown = table.set_axis(["in", "detector", "median SNR", "95 % from", "to", "rank"], axis=1)
        sections.append(Section("Detectors", embed_chart(chart) + render_table(shown), "detectors"))
    for kind, title in _KINDS:
        rows = differences[differences["what"] == kind].drop(columns="what")
        if len(rows):
            sections.append(Section(title, _fold(rows), kind))
    return _render(names, sections, found, strip)


def render_loop_differences(names: Names, verdicts: tuple[Mapping[str, Any], Mapping[str, Any]]) -> str:
    """Page of two loops, from their verdicts (``verdict.json``)."""
    rows, named_by = [], []
    for side, verdict in zip(names, verdicts, strict=True):
        effects: dict[str, list[str]] = {joint: [] for joint in verdict["joints"]}
        for entry in verdict["verdict"]:
            effects.setdefault(entry["joint"], []).append(entry["effect"])
        named_by.append(effects)
        for joint, errors in verdict["joints"].items():
            rows.append(
                {
                    "side": side,
                    "joint": joint,
                    "before": errors.get("rms_before"),
                    "after": errors.get("rms_after"),
                    "unit": errors.get("unit", ""),
                    "named": words(join_words(sorted(effects[joint]))) or "nothing",
                }
            )
    table = pd.DataFrame(rows)
    sides = side_table({name: table[table["side"] == name] for name in names}, "joint", "after")
    chart = chart_sides(
        names,
        "Error of each joint after the correction",
        "RMS error on the test runs",
        "joint",
        "In the joint's unit of torque.",
    )
    told = tell_loops(names, *named_by)
    strip = Strip(
        " ".join(told[:2]),
        "good" if named_by[0] == named_by[1] else "unsure",
        "Effects are compared by name, joint by joint.",
        "Each error is on that diagnosis's own test runs.",
        _link("joints", "Joints"),
    )
    sections = [
        Section("What differs", render_part(listed=told), "summary"),
        Section("Joints", embed_chart(chart) + render_table(table.rename(columns={"side": "in"})), "joints"),
    ]
    return _render(names, sections, {"sides": sides}, strip)


def _link(anchor: str, title: str) -> Markup:
    return Markup('See <a href="#{}">{}</a>.').format(anchor, title)


def _render(names: Names, sections: list[Section], found: Mapping[str, pd.DataFrame], strip: Strip) -> str:
    title, labels = (
        f"{names[0]} and {names[1]}",
        {"column": {"thing": "name", "low": "95 % from", "high": "to"}},
    )
    return render_page(title, sections, "", "Made by wearscope.", tables=found, labels=labels, strip=strip)


def _fold(rows: pd.DataFrame) -> Markup:
    """Table of what differs, recordings only counted, folded where it is long."""
    recordings = rows["item"].str.startswith("traces/") | rows["item"].str.contains("/traces/")
    left, count = rows[~recordings], int(recordings.sum())
    notes = [f"And {count_text(count, 'recording')}."] if count else []
    table = [render_table(left)] if len(left) else []
    if len(left) <= _LONG:
        return render_part(parts=table) + render_part(notes=notes)
    return render_part(notes=notes, folded=[(f"{len(left)} rows", False, table[0])])


def tell_studies(
    names: Names, rankings: tuple[pd.DataFrame, pd.DataFrame], differences: pd.DataFrame
) -> list[str]:
    """What differs between two studies, in sentences, conclusions first."""
    best = [str(one.sort_values("rank")["fda"].iloc[0]) if len(one) else None for one in rankings]
    told = []
    if best[0] is not None and best[0] == best[1]:
        told.append(f"{best[0]} has the highest median SNR in both.")
    else:
        told += [
            f"{one} has the highest median SNR in {name}."
            for one, name in zip(best, names, strict=True)
            if one
        ]
    concluded = differences[differences["what"] == "conclusion"]
    changed = concluded[concluded["outcome"] == "differs"]
    told += [f"{words(row.item).rstrip('.')}: {row.detail}." for row in changed.head(_TOLD).itertuples()]
    if len(changed) > _TOLD:
        told.append(f"{len(changed) - _TOLD} more conclusions differ.")
    for name, outcome in zip(names, ("only in a", "only in b"), strict=True):
        if count := int((concluded["outcome"] == outcome).sum()):
            told.append(f"{count_text(count, 'conclusion')} in {name} only.")
    counts = [count_text(n, kind) for kind, _ in _KINDS if (n := int((differences["what"] == kind).sum()))]
    total = len(differences)
    told.append(f"{join_words(counts)} differ{'s' if total == 1 else ''}." if counts else "Nothing differs.")
    return told


def tell_loops(names: Names, left: Mapping[str, list[str]], right: Mapping[str, list[str]]) -> list[str]:
    """What two verdicts name differently, a sentence for the joints with the same difference."""
    found: dict[str, list[str]] = {}
    for joint in dict.fromkeys([*left, *right]):
        only = [
            f"{words(join_words(gone))} in {name} only"
            for name, one, other in zip(names, (left, right), (right, left), strict=True)
            if (gone := sorted(set(one.get(joint, [])) - set(other.get(joint, []))))
        ]
        if only:
            found.setdefault(join_words(only), []).append(joint)
    told = [f"{join_words(joints)}: {only}." for only, joints in found.items()]
    return told or ["Both name the same effects at every joint."]
