"""What a run prints: one line on work done and time left, and how the run ended.

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
    """Print lines in which no text of a file, and no path, can steer the terminal."""
    for line in lines:
        click.echo(click.style(escape_text(str(line)), bold=bold or None, reset=bold), err=err)


#: Seconds between two lines where the output is no terminal.
EVERY = 60.0


def format_seconds(seconds: float) -> str:
    """Short text: ``45 s``, ``3 min 20 s``, ``2 h 5 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def describe(done: Progress, elapsed: float) -> str:
    """Text of the line."""
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
    """Give a `watch` for `call_snakemake`: a line that moves, plain lines where there is no terminal.

    Parameters
    ----------
    verbose : bool
        Show all that Snakemake says instead.
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
    """Path from the working directory where it lies below it."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(path)


def show_result(path: Path, opened: bool = False, err: bool = False) -> None:
    """Print the top of a page in five lines, and where the page is."""
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
    """Say what a finished run answers and how long it took, and keep the answers.

    Parameters
    ----------
    pages : sequence of Path
        Of what was asked for, below ``results``; the first is shown.
    seconds : float
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
        except DamagedFile as error:  # the run did not rewrite this file, since nothing it depends on changed
            say(error, err=True)
    free = shutil.disk_usage(".").free / 1e9
    say(f"Done in {format_seconds(seconds)}; {free:.0f} GB of the disk are free.", err=True)


def end_badly(logs: Sequence[str], targets: Sequence[str]) -> None:
    """Say which rule failed, by Snakemake's logs of the run, and print the rule's last words."""
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
