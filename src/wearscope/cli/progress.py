"""One line that says what is done and what time is left."""

import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import click

from wearscope.cli.workflow import Progress
from wearscope.errors import escape_text


def say(line: object, err: bool = False, bold: bool = False) -> None:
    """Print a line in which no text of a file, and no path, can steer the terminal."""
    click.echo(click.style(escape_text(str(line)), bold=bold or None, reset=bold), err=err)


#: Where the output is no terminal, a line is written each so many seconds.
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
