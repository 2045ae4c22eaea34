"""The command `wearscope compare`: two studies or two closed loops side by side."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from wearscope.cli.progress import say
from wearscope.cli.show import find_results, print_table
from wearscope.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from wearscope.archive.comparison import Content

#: Largest number of differing conclusions that are described in sentences.
_TOLD = 5
#: Beginning of the sentence on a conclusion, by the table that holds it.
_TABLES = {"findings": "Compared with the paper", "audit_verdicts": "Checked directly"}


@click.command()
@click.argument("a")
@click.argument("b")
@click.option(
    "--all",
    "everything",
    is_flag=True,
    help="List every setting, version and file, also those that are the same.",
)
def compare(a, b, everything):  # type: ignore[no-untyped-def]
    """Show how A and B differ: two studies, folders of results, archives, or two diagnoses.

    \b
    Examples:
      wearscope compare results/quick results/paper
      wearscope compare my-study your-study --all
      wearscope compare before.tar after.tar
      wearscope compare results/closed_loop/arm-may results/closed_loop/arm-june
    """
    left, right = (_find(one) for one in (a, b))
    loops = [(one / "verdict.json").is_file() for one in (left, right)]
    if all(loops):
        _compare_loops(left, right)
    elif any(loops):
        raise InputError(f"{a} and {b}: one is a loop and the other a study; compare two of a kind.")
    else:
        _compare_studies(left, right, everything)


def _name(left: Path, right: Path) -> tuple[str, str]:
    """Return names for two results: the last parts of their paths, as many as are needed to differ."""
    parts = left.absolute().parts, right.absolute().parts
    count = next((k for k in range(1, max(map(len, parts))) if parts[0][-k:] != parts[1][-k:]), 1)
    return "/".join(parts[0][-count:]), "/".join(parts[1][-count:])


def _find(place: str) -> Path:
    """Return the archive or the folder of results at a place."""
    path = Path(place)
    return path if path.is_file() and path.suffix == ".tar" else find_results(place)


def _compare_studies(left: Path, right: Path, everything: bool) -> None:
    """Print the answers of two studies, their rankings, and with `everything` all settings and files."""
    from wearscope.archive.comparison import Content, compare_contents
    from wearscope.cli.tables import format_value
    from wearscope.reporting.labels import detector_name

    sides = Content(left), Content(right)
    differences = compare_contents(*sides, detector_name)
    if not everything:
        same = differences["outcome"].isin(["same bytes", "same values"])
        differences = differences[~same]
    rankings = [_read_ranking(side) for side in sides]
    ranks = [
        dict(zip(one["fda"], one["median"].astype(float), strict=True)) if len(one) else {}
        for one in rankings
    ]
    names = _name(left, right)
    from wearscope.reporting.page_strip import parse_strip

    pages = [side.read("report.html") if "report.html" in side.digests else b"" for side in sides]
    strips = [parse_strip(page.decode("utf-8", "replace")) for page in pages]
    answers = (strips[0].answer if strips[0] else "", strips[1].answer if strips[1] else "")
    say(*_tell_answers(names, answers), *_tell_studies(names, (rankings[0], rankings[1]), differences))
    headers = ["detector", f"median SNR in {names[0]}", f"in {names[1]}"]
    detectors = list(dict.fromkeys([*ranks[0], *ranks[1]]))
    print_table(headers, [[one, *(format_value(rank.get(one)) for rank in ranks)] for one in detectors])
    if everything:
        rows = [[format_value(value) for value in row] for row in differences.itertuples(index=False)]
        print_table(list(differences.columns), rows)


def _read_ranking(side: "Content") -> "pd.DataFrame":
    """Read the ranking of a study, with full names of the detectors; empty where it has no ranking."""
    import pandas as pd

    from wearscope.reporting.labels import detector_name

    name = "ranking.parquet"
    if name not in side.digests:
        return pd.DataFrame()
    table = side.table(name)
    for column in ("rank", "median", "median_low", "median_high"):
        if column not in table or not pd.api.types.is_numeric_dtype(table[column]) or "fda" not in table:
            told = f"{side.path}: {name}: is no ranking of detectors (column {column})"
            raise InputError(f"{told}; run the study again.")
    codes = table["fda"].astype(str)
    return table.assign(fda=[side.name_detector(code, detector_name) for code in codes])


def _compare_loops(left: Path, right: Path) -> None:
    """Print errors and named effects of two closed loops, joint by joint."""
    from wearscope.cli.tables import format_value
    from wearscope.reporting.labels import effect_name
    from wearscope.storage.verdicts import read_verdict

    verdicts = [read_verdict(one / "verdict.json") for one in (left, right)]
    joints = list(dict.fromkeys(name for verdict in verdicts for name in verdict["joints"]))
    headers = ["joint"]
    names = _name(left, right)
    for name in names:
        headers += [f"{name}: before", "after", "named"]
    named_by = [
        {joint: [one["effect"] for one in verdict["verdict"] if one["joint"] == joint] for joint in joints}
        for verdict in verdicts
    ]
    say(*_tell_loops(names, named_by[0], named_by[1]))
    rows = []
    for joint in joints:
        row = [joint]
        for verdict, named in zip(verdicts, named_by, strict=True):
            errors = verdict["joints"].get(joint, {})
            both = (errors.get("rms_before"), errors.get("rms_after"))
            row += [*map(format_value, both), ", ".join(map(effect_name, named[joint]))]
        rows.append(row)
    print_table(headers, rows)


def _name_item(item: str) -> str:
    """Return the subject of a conclusion in words."""
    from wearscope.reporting.labels import upper_first, words

    table, _, rest = item.partition(": ")
    rest = re.sub(r"^Q-\d, ", "", words(rest)).rstrip(".")
    return f"{_TABLES.get(table, upper_first(words(table)))}: {rest}"


def _tell_answers(names: tuple[str, str], answers: tuple[str, str]) -> list[str]:
    """Return sentences on the answers of both pages; none where a page has no answer."""
    if not all(answers):
        return []
    if answers[0] == answers[1]:
        return [f"Both answer: {answers[0]}"]
    told = [f"{name}: {answer}" for name, answer in zip(names, answers, strict=True)]
    return ["The answers differ.", *told]


def _tell_studies(
    names: tuple[str, str], rankings: tuple["pd.DataFrame", "pd.DataFrame"], differences: "pd.DataFrame"
) -> list[str]:
    """Return sentences on the differences between two studies, conclusions first."""
    from wearscope.reporting.labels import count_text, words
    from wearscope.reporting.page import say_lines

    best = [str(one.sort_values("rank")["fda"].iloc[0]) if len(one) else "" for one in rankings]
    concluded = differences[differences["what"] == "conclusion"]
    changed = concluded[concluded["outcome"] == "differs"]
    shown = [f"{_name_item(row.item)}: {words(row.detail)}" for row in changed.head(_TOLD).itertuples()]
    only = [
        (name, int((concluded["outcome"] == outcome).sum()))
        for name, outcome in zip(names, ("only in a", "only in b"), strict=True)
    ]
    kinds = ("conclusion", "setting", "version", "table", "file")
    counts = [count_text(n, kind) for kind in kinds if (n := int((differences["what"] == kind).sum()))]
    leaders, more = list(zip(best, names, strict=True)), len(changed) - _TOLD
    told = (leaders, shown, more, only, counts, len(differences))
    lines = say_lines("cli/words.html", "studies", *told)
    return [line.striptags() for line in lines]


def _tell_loops(
    names: tuple[str, str], left: Mapping[str, list[str]], right: Mapping[str, list[str]]
) -> list[str]:
    """Return sentences on the effects that two verdicts name differently; equal differences share one."""
    from wearscope.reporting.labels import effect_name, join_words

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
