"""One line that says what is done and what time is left."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from wearscope.cli.workflow import Progress as Done

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


def describe(done: Done, elapsed: float) -> str:
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
    console = Console(stderr=True)
    if verbose:
        yield lambda done, elapsed, line: console.print(
            line.rstrip(), markup=False, highlight=False, soft_wrap=True
        )
    elif console.is_terminal:
        columns = BarColumn(bar_width=20), TextColumn("{task.description}", markup=False)
        with Progress(*columns, console=console, transient=True) as bar:
            task = bar.add_task("planning", total=None)

            def move(done: Done, elapsed: float, line: str) -> None:
                doing = done.message if done.part is None else ""
                text = describe(done, elapsed) + (f": {doing}" if doing else "")
                room = console.width - 24
                bar.update(task, total=done.total or None, completed=done.done, description=text[:room])

            yield move
    else:
        last = time.monotonic()

        def write(done: Done, elapsed: float, line: str) -> None:
            nonlocal last
            if time.monotonic() - last >= EVERY:
                last = time.monotonic()
                doing = f": {done.message}" if done.message and done.part is None else ""
                console.print(describe(done, elapsed) + doing, markup=False, highlight=False, soft_wrap=True)

        yield write
