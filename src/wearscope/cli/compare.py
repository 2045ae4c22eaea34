"""Two results beside each other."""

import json
from pathlib import Path

import click

from wearscope.cli.show import find_results, print_table
from wearscope.errors import InputError


@click.command()
@click.argument("a")
@click.argument("b")
@click.option("--all", "everything", is_flag=True, help="Also what is the same.")
def compare(a, b, everything):  # type: ignore[no-untyped-def]
    """Say how A and B differ: two studies, folders of results, archives, or two loops.

    \b
    Examples:
      wearscope compare results/quick results/paper
      wearscope compare my-study your-study
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


def _find(place: str) -> Path:
    path = Path(place)
    return path if path.is_file() and path.suffix == ".tar" else find_results(place)


def _compare_studies(left: Path, right: Path, everything: bool) -> None:
    from wearscope.archive import compare_archives
    from wearscope.cli.tables import format_value

    differences = compare_archives(left, right)
    if not everything:
        same = differences["outcome"].isin(["same bytes", "same values"])
        differences = differences[~same]
    ranks = []
    for side in (left, right):
        file = side / "ranking.parquet"
        ranks.append(_read_ranking(file) if file.is_file() else {})
    headers = ["detector", f"median SNR in {left.name}", f"in {right.name}"]
    names = list(dict.fromkeys([*ranks[0], *ranks[1]]))
    print_table(headers, [[name, *(format_value(rank.get(name)) for rank in ranks)] for name in names])
    rows = [[format_value(value) for value in row] for row in differences.itertuples(index=False)]
    print_table(list(differences.columns), rows)
    if not rows:
        click.echo("Nothing differs.")


def _read_ranking(path: Path) -> dict[str, float]:
    from wearscope import tables

    frame = tables.read_table(path)
    column = next((one for one in ("median", "median_snr", "snr") if one in frame), None)
    return {} if column is None else dict(zip(frame["fda"], frame[column].astype(float), strict=True))


def _compare_loops(left: Path, right: Path) -> None:
    from wearscope.cli.tables import format_value

    verdicts = [json.loads((one / "verdict.json").read_text(encoding="utf-8")) for one in (left, right)]
    joints = list(dict.fromkeys(name for verdict in verdicts for name in verdict["joints"]))
    headers = ["joint"]
    for side in (left, right):
        headers += [f"{side.name}: before", "after", "named"]
    rows = []
    for joint in joints:
        row = [joint]
        for verdict in verdicts:
            errors = verdict["joints"].get(joint, {})
            named = [entry["effect"] for entry in verdict["verdict"] if entry["joint"] == joint]
            row += [
                format_value(errors.get("rms_before")),
                format_value(errors.get("rms_after")),
                ", ".join(named),
            ]
        rows.append(row)
    print_table(headers, rows)
