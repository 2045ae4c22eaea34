"""The page of two results side by side: studies or loops, what differs first."""

import re
from collections.abc import Mapping
from typing import Any

import pandas as pd
from markupsafe import Markup

from wearscope.reporting.charts.sides import chart_sides, side_table
from wearscope.reporting.labels import count_text, effect_name, join_words, upper_first, words
from wearscope.reporting.page import Section, embed_chart, render_page, render_part, render_table
from wearscope.reporting.page_strip import Strip

Names = tuple[str, str]
#: Rows above which a table is folded, and conclusions that are told in sentences.
_LONG, _TOLD = 25, 5
#: What a conclusion is of, by the table that has it.
_TABLES = {"findings": "Compared with the paper", "audit_verdicts": "Checked directly"}
#: What differs, by what the comparison calls it.
_KINDS = {
    "conclusion": "Conclusions",
    "setting": "Settings",
    "version": "Versions",
    "table": "Tables",
    "file": "Files",
}


def render_study_differences(
    names: Names, rankings: tuple[pd.DataFrame, pd.DataFrame], differences: pd.DataFrame, answers: Names
) -> str:
    """Page of two studies.

    Parameters
    ----------
    names : tuple of str
        What the two are called.
    rankings : tuple of DataFrame
        ``ranking.parquet`` of each; empty where there is none.
    differences : DataFrame
        As `wearscope.archives.comparison.compare_contents` returns it.
    answers : tuple of str
        What each page answers; empty where there is none.
    """
    differences = differences[~differences["outcome"].isin(["same bytes", "same values"])]
    top, told = tell_answers(names, answers), tell_studies(names, rankings, differences)
    top, told = (top, told) if top else (told[:2], told[2:])
    settings = int((differences["what"] == "setting").sum())
    caveat = f"{count_text(settings, 'setting')} differ{'s' if settings == 1 else ''} too, and may be why."
    kinds = [kind for kind in _KINDS if kind in set(differences["what"])]
    strip = Strip(
        " ".join(top),
        "unsure" if len(differences) else "good",
        "Every table was compared by its values; settings and versions where both record them.",
        caveat if settings else "No setting that both record differs.",
        _link(*([(kind, _KINDS[kind]) for kind in kinds] + [("summary", "What differs")])[0]),
    )
    sections, sides = [], {name: one for name, one in zip(names, rankings, strict=True) if len(one)}
    if sides:
        quantity, caption = "median signal-to-noise ratio", "Bars: 95 % intervals."
        chart = chart_sides(names, "Median SNR of each detector", quantity, "detector", caption)
        table = pd.concat([frame.assign(side=name) for name, frame in sides.items()])
        columns = "side|in; fda|detector; median|median SNR; median_low|95 % from; median_high|to; rank"
        shown = embed_chart(chart) + render_table(table, columns=columns)
        sections.append(Section("Detectors", shown, "detectors"))
    for kind in kinds:
        rows = differences[differences["what"] == kind].drop(columns="what")
        if kind == "conclusion":
            rows = rows.assign(item=rows["item"].map(_name_item), detail=rows["detail"].map(words))
        else:  # long names may break after a point
            rows = rows.assign(item=rows["item"].str.replace(".", ".\N{ZERO WIDTH SPACE}", regex=False))
        sides_named = {"only in a": f"only in {names[0]}", "only in b": f"only in {names[1]}"}
        sections.append(Section(_KINDS[kind], _fold(rows.replace({"outcome": sides_named})), kind))
    drawn = {"sides": side_table(sides, "fda", "median")} if sides else {}
    return _render(names, told, sections, drawn, strip)


def render_loop_differences(names: Names, verdicts: tuple[Mapping[str, Any], Mapping[str, Any]]) -> str:
    """Page of two loops, from their verdicts (``verdict.json``)."""
    rows, named_by = [], []
    for side, verdict in zip(names, verdicts, strict=True):
        effects: dict[str, list[str]] = {joint: [] for joint in verdict["joints"]}
        for entry in verdict["verdict"]:
            effects.setdefault(entry["joint"], []).append(entry["effect"])
        named_by.append(effects)
        for joint, errors in verdict["joints"].items():
            named = join_words([*map(effect_name, sorted(effects[joint]))]) or "nothing"
            rows.append(dict(errors) | {"side": side, "joint": joint, "named": named})
    table = pd.DataFrame(rows)
    sides = {name: table[table["side"] == name] for name in names}
    told = tell_loops(names, *named_by)
    strip = Strip(
        " ".join(told[:2]),
        "good" if named_by[0] == named_by[1] else "unsure",
        "Effects are compared by name, joint by joint.",
        "Each error is on that diagnosis's own test runs.",
        _link("joints", "Joints"),
    )
    chart = chart_sides(
        names,
        "Error of each joint after the correction",
        "RMS error on the test runs",
        "joint",
        "In the joint's unit of torque.",
    )
    columns = "side|in; joint; rms_before|before; rms_after|after; unit; named"
    joints = Section("Joints", embed_chart(chart) + render_table(table, columns=columns), "joints")
    return _render(names, told[2:], [joints], {"sides": side_table(sides, "joint", "rms_after")}, strip)


def _name_item(item: str) -> str:
    """What a conclusion is of, in words."""
    table, _, rest = item.partition(": ")
    rest = re.sub(r"^Q-\d, ", "", words(rest)).rstrip(".")
    return f"{_TABLES.get(table, upper_first(words(table)))}: {rest}"


def _link(anchor: str, title: str) -> Markup:
    return Markup('See <a href="#{}">{}</a>.').format(anchor, title)


def _render(
    names: Names, told: list[str], sections: list[Section], drawn: Mapping[str, pd.DataFrame], strip: Strip
) -> str:
    first = Section("What differs", render_part(listed=told) if told else "", "summary")
    labels = {"column": {"thing": "name", "low": "95 % from", "high": "to"}}
    title = f"{names[0]} and {names[1]}"
    parts = [first, *sections]
    return render_page(title, parts, "", "Made by wearscope.", tables=drawn, labels=labels, strip=strip)


def _fold(rows: pd.DataFrame) -> Markup:
    """Table of what differs, recordings only counted, folded where it is long."""
    recordings = rows["item"].str.contains(r"(?:^|/)traces/")
    left, count = rows[~recordings], int(recordings.sum())
    notes = [f"And {count_text(count, 'recording')}."] if count else []
    table = render_table(left)
    if len(left) > _LONG:
        return render_part(notes=notes, folded=[(f"{len(left)} rows", False, table)])
    return render_part(parts=[table] if len(left) else []) + render_part(notes=notes)


def tell_answers(names: Names, answers: Names) -> list[str]:
    """What both pages answer, in sentences; [] where one has no answer."""
    if not all(answers):
        return []
    if answers[0] == answers[1]:
        return [f"Both answer: {answers[0]}"]
    told = [f"{name}: {answer}" for name, answer in zip(names, answers, strict=True)]
    return ["The answers differ.", *told]


def tell_studies(
    names: Names, rankings: tuple[pd.DataFrame, pd.DataFrame], differences: pd.DataFrame
) -> list[str]:
    """What differs between two studies, in sentences, conclusions first."""
    best = [str(one.sort_values("rank")["fda"].iloc[0]) if len(one) else None for one in rankings]
    pairs = [(one, name) for one, name in zip(best, names, strict=True) if one]
    if len(pairs) == 2 and best[0] == best[1]:
        pairs = [(str(best[0]), "both")]
    told = [f"{one} has the highest median SNR in {name}." for one, name in pairs]
    concluded = differences[differences["what"] == "conclusion"]
    changed = concluded[concluded["outcome"] == "differs"]
    told += [f"{_name_item(row.item)}: {words(row.detail)}." for row in changed.head(_TOLD).itertuples()]
    if len(changed) > _TOLD:
        more = len(changed) - _TOLD
        told.append(f"{count_text(more, 'more conclusion')} differ{'s' if more == 1 else ''}.")
    for name, outcome in zip(names, ("only in a", "only in b"), strict=True):
        if count := int((concluded["outcome"] == outcome).sum()):
            told.append(f"{count_text(count, 'conclusion')} in {name} only.")
    counts = [count_text(n, kind) for kind in _KINDS if (n := int((differences["what"] == kind).sum()))]
    verb = "differs" if len(differences) == 1 else "differ"
    return [*told, f"{join_words(counts)} {verb}." if counts else "Nothing differs."]


def tell_loops(names: Names, left: Mapping[str, list[str]], right: Mapping[str, list[str]]) -> list[str]:
    """What two verdicts name differently, a sentence for the joints with the same difference."""
    found: dict[str, list[str]] = {}
    for joint in dict.fromkeys([*left, *right]):
        only = [
            f"{join_words([*map(effect_name, gone)])} in {name} only"
            for name, one, other in zip(names, (left, right), (right, left), strict=True)
            if (gone := sorted(set(one.get(joint, [])) - set(other.get(joint, []))))
        ]
        if only:
            found.setdefault(join_words(only), []).append(joint)
    told = [f"{join_words(joints)}: {only}." for only, joints in found.items()]
    return told or ["Both name the same effects at every joint."]
