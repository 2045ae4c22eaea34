"""The commands `wearscope show` and `wearscope history`: tables of results, and all answers of a folder."""

import glob
import shutil
import sys
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from textwrap import wrap

import click

from wearscope import limits
from wearscope.cli.progress import say
from wearscope.cli.study import find_last_study
from wearscope.errors import InputError, escape_text
from wearscope.storage.files import check_shown

#: Results that `show` lists first, and the question that each answers.
QUESTIONS = {
    "findings": "what the study found, compared with the paper",
    "ranking": "Q-2: which detector is best",
    "snr": "Q-2: signal-to-noise ratio by cell",
    "sensitivity": "Q-1: which factors matter",
    "group_scope": "Q-3: share of cells in which a detector works",
    "scope": "Q-3: where a detector works, by cell",
    "validation": "how well the surrogates fit",
}


def print_table(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table as wide as the terminal; nothing where it has no rows."""
    if not rows:
        return
    room = shutil.get_terminal_size().columns if sys.stdout.isatty() else 160
    lines = [[escape_text(one) for one in line] for line in (headers, *rows)]
    widest = [max(1, *map(len, column)) for column in zip(*lines, strict=True)]
    most = room
    while most > 1 and sum(min(most, width) + 2 for width in widest) - 2 > room:
        most -= 1
    widths = [min(most, width) for width in widest]
    for k, line in enumerate(lines):
        cells = [wrap(one, width) or [""] for one, width in zip(line, widths, strict=True)]
        for parts in zip_longest(*cells, fillvalue=""):
            text = "  ".join(part.ljust(width) for part, width in zip(parts, widths, strict=True))
            say(text.rstrip(), bold=k == 0)


def find_results(place: str | None) -> Path:
    """Return a folder of results, which is given itself or by its study."""
    if place is not None and Path(place).is_dir() and not (Path(place) / "config").is_dir():
        return Path(place)
    return find_last_study(place).results


def find_item(name: str, folder: Path) -> Path:
    """Return the file of a table, which is given by its path or by its name in a folder of results.

    Raises
    ------
    InputError
        Where there is no such table.
    """
    for path in (Path(name), folder / name):
        if _is_file(path):
            return path
    plain = glob.escape(name.lstrip("/"))
    patterns = (f"{plain}.parquet", f"*/{plain}.parquet", f"**/{plain}.parquet")
    for pattern in patterns if len(name.encode()) < limits.NAME else ():
        found = sorted(folder.glob(pattern))
        if found:
            return found[0]
    there = (
        ", ".join(sorted({file.stem for file in list_items(folder)})) or "nothing yet; run the study first"
    )
    raise InputError(f"{folder}: there is no table '{name[:80]}'; there are {there}.")


def _is_file(path: Path) -> bool:
    """Return whether a path is a file; an impossible path is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # an impossible name
        return False


def list_items(folder: Path) -> list[Path]:
    """Return the files of the tables in a folder of results."""
    return sorted([*folder.glob("*.parquet"), *folder.glob("design/*.parquet")])


@click.command()
@click.argument("item", required=False)
@click.option(
    "--in",
    "place",
    metavar="PLACE",
    help="Study, or folder of results; by default the study that was run here last.",
)
@click.option("--where", "-w", multiple=True, metavar="COLUMN=VALUE", help="Show only rows with this value.")
@click.option("--sort", metavar="COLUMN", help="Sort by a column; with '-' before it, the largest first.")
@click.option("--columns", metavar="A,B", help="Show only these columns.")
@click.option("--rows", default=30, show_default=True, help="Largest number of rows; 0 for all.")
def show(item, place, where, sort, columns, rows):  # type: ignore[no-untyped-def]
    """Show a table of a study in the terminal; without ITEM, list the tables.

    ITEM is a name, or the path of a .parquet, .json or .csv file.

    \b
    Examples:
      wearscope show                              list the tables
      wearscope show ranking
      wearscope show snr --where fda=C --sort -snr --rows 10
      wearscope show sensitivity --in my-study
    """
    from wearscope.cli.tables import frame_rows, read_frame
    from wearscope.reporting.labels import read_detector_names
    from wearscope.storage.files import SETTINGS

    given = item is not None and _is_file(Path(item))
    folder = Path() if given else find_results(place)
    if item is None:
        _list(folder)
        return
    path = find_item(item, folder)
    check_shown(path)
    if path.suffix in (".parquet", ".csv", ".json"):
        frame, units = read_frame(path)
        names = read_detector_names(folder / SETTINGS)
        headers, cells, left = frame_rows(frame, units, str(path), where, sort, columns, rows, names)
        print_table(headers, cells)
        if left:
            say(f"{left} more rows; --rows 0 shows all, --where COLUMN=VALUE some.", err=True)
    else:
        raise InputError(f"{path}: is no table; name a .parquet, .json or .csv file.")


def _tell(path: Path) -> str:
    """Return the description of a table; empty where it has none."""
    return "points that are simulated" if path.parent.name == "design" else QUESTIONS.get(path.stem, "")


def _list(folder: Path) -> None:
    """Print the tables of a folder of results, the most important first."""
    items = list_items(folder)
    if not items:
        raise InputError(f"{folder}: holds no results yet; run the study with 'wearscope run'.")
    rank = {name: k for k, name in enumerate(QUESTIONS)}
    items.sort(key=lambda path: (rank.get(path.stem, len(rank)), path.parent != folder, path.stem))
    rows = [(p.stem, _tell(p), p.relative_to(folder).as_posix()) for p in items]
    print_table(("name", "what it says", "file"), rows)


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), default=Path("results"))
@click.option("--open", "opened", is_flag=True, help="Open the page in the browser.")
def history(folder, opened):  # type: ignore[no-untyped-def]
    """List all studies and verdicts below FOLDER, newest first, and write a page with their trend.

    \b
    Examples:
      wearscope history
      wearscope history my-project/results --open
    """
    from wearscope.reporting.history_page import find_answers, render_history
    from wearscope.storage import tables

    if not folder.is_dir():
        raise InputError(f"{folder}: is no folder; name one with results in it.")
    found = find_answers(folder)
    if not found:
        raise InputError(f"{folder}: holds no page with an answer yet; run a study or a diagnosis first.")
    rows = [(one.when, one.kind, one.name, one.version, one.settings, one.strip.answer) for one in found]
    print_table(("when (UTC)", "what", "name", "version", "settings", "answer"), rows)
    page = folder / "history.html"
    tables.write_text(page, render_history(folder, found))
    say(page)
    if opened:
        click.launch(str(page))
