"""Two results side by side."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from wearscope.cli.say import say
from wearscope.cli.show import find_results, print_table
from wearscope.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from wearscope.archives.comparison import Content


@click.command()
@click.argument("a")
@click.argument("b")
@click.option(
    "--all",
    "everything",
    is_flag=True,
    help="Every setting, version and file, the same ones too.",
)
@click.option("--page", type=click.Path(path_type=Path), help="Write a page of both to this file, too.")
@click.option("--open", "opened", is_flag=True, help="Open it in the browser.")
def compare(a, b, everything, page, opened):  # type: ignore[no-untyped-def]
    """Say how A and B differ: two studies, folders of results, archives, or two loops.

    \b
    Examples:
      wearscope compare results/quick results/paper
      wearscope compare my-study your-study --page both.html --open
      wearscope compare before.tar after.tar
      wearscope compare results/closed_loop/arm-may results/closed_loop/arm-june
    """
    left, right = (_find(one) for one in (a, b))
    loops = [(one / "verdict.json").is_file() for one in (left, right)]
    if opened and page is None:
        raise InputError("--open: there is no page to open; say where it goes with --page FILE.")
    if all(loops):
        html = _compare_loops(left, right)
    elif any(loops):
        raise InputError(f"{a} and {b}: one is a loop and the other a study; compare two of a kind.")
    else:
        html = _compare_studies(left, right, everything)
    if page is not None:
        from wearscope import tables

        tables.write_text(page, html())
        say(page)
        if opened:
            click.launch(str(page))


def _name(left: Path, right: Path) -> tuple[str, str]:
    """What two results are called: by their folders, with as much of the path as tells them apart."""
    parts = left.absolute().parts, right.absolute().parts
    count = next((k for k in range(1, max(map(len, parts))) if parts[0][-k:] != parts[1][-k:]), 1)
    return "/".join(parts[0][-count:]), "/".join(parts[1][-count:])


def _say(sentences: Iterable[str]) -> None:
    for one in sentences:
        say(one)


def _find(place: str) -> Path:
    path = Path(place)
    return path if path.is_file() and path.suffix == ".tar" else find_results(place)


def _compare_studies(left: Path, right: Path, everything: bool) -> Callable[[], str]:
    """Show what differs; return what writes a page of it."""
    from wearscope.archives.comparison import Content, compare_contents
    from wearscope.cli.tables import format_value
    from wearscope.reporting.labels import detector_name

    sides = Content(left), Content(right)
    found = differences = compare_contents(*sides, detector_name)
    if not everything:
        same = differences["outcome"].isin(["same bytes", "same values"])
        differences = differences[~same]
    rankings = [_read_ranking(side) for side in sides]
    ranks = [
        dict(zip(one["fda"], one["median"].astype(float), strict=True)) if len(one) else {}
        for one in rankings
    ]
    names = _name(left, right)
    from wearscope.reporting.differences_page import render_study_differences, tell_answers, tell_studies
    from wearscope.reporting.page_strip import parse_strip

    pages = [side.read("report.html") if "report.html" in side.digests else b"" for side in sides]
    strips = [parse_strip(page.decode("utf-8", "replace")) for page in pages]
    answers = (strips[0].answer if strips[0] else "", strips[1].answer if strips[1] else "")
    _say([*tell_answers(names, answers), *tell_studies(names, (rankings[0], rankings[1]), differences)])
    headers = ["detector", f"median SNR in {names[0]}", f"in {names[1]}"]
    detectors = list(dict.fromkeys([*ranks[0], *ranks[1]]))
    print_table(headers, [[one, *(format_value(rank.get(one)) for rank in ranks)] for one in detectors])
    if everything:
        rows = [[format_value(value) for value in row] for row in differences.itertuples(index=False)]
        print_table(list(differences.columns), rows)

    def write() -> str:
        return render_study_differences(names, (rankings[0], rankings[1]), found, answers)

    return write


def _read_ranking(side: "Content") -> "pd.DataFrame":
    """Detectors, by their full names where the settings tell, by median SNR; empty where it is not there."""
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


def _compare_loops(left: Path, right: Path) -> Callable[[], str]:
    """Show both joint by joint; return what writes a page of it."""
    from wearscope.cli.tables import format_value
    from wearscope.reporting.differences_page import render_loop_differences, tell_loops
    from wearscope.reporting.labels import effect_name
    from wearscope.verdicts import read_verdict

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
    _say(tell_loops(names, named_by[0], named_by[1]))
    rows = []
    for joint in joints:
        row = [joint]
        for verdict, named in zip(verdicts, named_by, strict=True):
            errors = verdict["joints"].get(joint, {})
            both = (errors.get("rms_before"), errors.get("rms_after"))
            row += [*map(format_value, both), ", ".join(map(effect_name, named[joint]))]
        rows.append(row)
    print_table(headers, rows)

    def write() -> str:
        return render_loop_differences(names, (verdicts[0], verdicts[1]))

    return write
