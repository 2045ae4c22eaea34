"""Output of a run: a line on the work done and the time left, and the end of the run.

A run ends with the answer and its page, or with the rule that failed.
"""

import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from wearscope.cli.workflow import Progress, explain_failure
from wearscope.errors import escape_text
from wearscope.storage.files import DamagedFile, check_answer


def say(*lines: object, err: bool = False, bold: bool = False) -> None:
    """Print lines without control characters, so that a file's text or a path cannot control the terminal."""
    for line in lines:
        click.echo(click.style(escape_text(str(line)), bold=bold or None, reset=bold), err=err)


#: Seconds between two lines where the output is no terminal.
EVERY = 60.0


def format_seconds(seconds: float) -> str:
    """Return a duration as short text: ``45 s``, ``3 min 20 s``, ``2 h 5 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def describe(done: Progress, elapsed: float) -> str:
    """Return the text of the progress line: jobs done, time used, time left."""
    if not done.total:
        return f"planning, {format_seconds(elapsed)}"
    text = f"{done.done} of {done.total} jobs, {format_seconds(elapsed)}"
    if done.part is not None:
        count, total, what = done.part
        text += f"; {count} of {total} {what}"
        left = done.part_seconds_left
    else:
        left = done.seconds_left(elapsed)
    return text if left is None else f"{text}, about {format_seconds(left)} left"


@contextmanager
def show_progress(verbose: bool) -> Iterator[Any]:
    """Yield a function that `call_snakemake` calls after each line of Snakemake, and that shows the progress.

    In a terminal it rewrites one line; elsewhere it prints a line about once a minute.

    Parameters
    ----------
    verbose : bool
        Whether to show all output of Snakemake instead.
    """
    last = time.monotonic()

    def move(done: Progress, elapsed: float, line: str) -> None:
        nonlocal last
        moves = sys.stderr.isatty()
        if not moves and time.monotonic() - last < EVERY:
            return
        last = time.monotonic()
        doing = f": {done.message}" if done.message and done.part is None else ""
        text = describe(done, elapsed) + doing
        if moves:
            full = "━" * (20 * done.done // done.total if done.total else 0)
            text = f"{full:─<20} {escape_text(text)}"[: shutil.get_terminal_size().columns - 1]
            print(f"\r{text}\x1b[K", end="", file=sys.stderr, flush=True)
        else:
            say(text, err=True)

    try:
        yield (lambda done, elapsed, line: say(line.rstrip(), err=True)) if verbose else move
    finally:
        if sys.stderr.isatty() and not verbose:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def shorten(path: Path) -> str:
    """Return a path relative to the working directory where it lies in it, else unchanged."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(path)


def show_result(path: Path, opened: bool = False, err: bool = False) -> None:
    """Print the answer at the top of a page, and the path of the page."""
    if path.is_file():
        from wearscope.reporting.page_strip import read_strip

        check_answer(path)
        strip = read_strip(path)
        if strip is not None:
            say(strip.answer, *(f"{heading}: {text}" for heading, text in strip.rows()), err=err)
        say(shorten(path), err=err)
        if opened:
            click.launch(str(path))


def end_well(pages: Sequence[Path], seconds: float, settings: str) -> None:
    """Print the answer of a finished run and its duration, and store the answers for the history.

    Parameters
    ----------
    pages : sequence of Path
        Pages of the run's targets, below ``results``; the answer of the first is printed.
    seconds : float
        Duration [s].
    settings : str
        Text of the settings, for the history.
    """
    from wearscope.reporting.history_page import keep_answer

    for page in pages:
        keep_answer(Path("results"), page, settings)
    say("", err=True)
    if pages:
        try:
            show_result(pages[0], err=True)
        except DamagedFile as error:  # damaged before this run, which had no reason to write it again
            say(error, err=True)
    free = shutil.disk_usage(".").free / 1e9
    say(f"Done in {format_seconds(seconds)}; {free:.0f} GB of the disk are free.", err=True)


def end_badly(logs: Sequence[str], targets: Sequence[str]) -> None:
    """Print which rule failed and the reason, both read from Snakemake's logs of the run."""
    progress = Progress()
    for log in logs:
        for line in Path(log).read_text(encoding="utf-8", errors="replace").splitlines():
            progress.read(line)
    told = explain_failure(progress, targets, Path.cwd())
    say("", err=True)
    if progress.rule:
        where = f" Its log is {progress.log}." if progress.log else ""
        say(f"The rule {progress.rule} failed: {told}{where}", err=True)
    else:
        say(told, err=True)
