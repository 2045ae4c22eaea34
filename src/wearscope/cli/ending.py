"""How a run of Snakemake ends on the terminal: with the answer and its page, or with the rule that failed."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import click

from wearscope.cli.progress import format_seconds, say
from wearscope.cli.workflow import Progress, explain_failure
from wearscope.storage.files import DamagedFile
from wearscope.storage.shown import check_answer


def shorten(path: Path) -> str:
    """Path from the working directory where it lies below it."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(path)


def show_result(path: Path, opened: bool = False, err: bool = False) -> None:
    """Say what a page says on top, in five lines, and where it is."""
    if path.is_file():
        from wearscope.reporting.page_strip import read_strip

        check_answer(path)
        strip = read_strip(path)
        if strip is not None:
            say(strip.answer, err=err)
            for heading, text in strip.rows():
                say(f"{heading}: {text}", err=err)
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
        except DamagedFile as error:  # which the run had no reason to make again
            say(error, err=True)
    free = shutil.disk_usage(".").free / 1e9
    say(f"Done in {format_seconds(seconds)}; {free:.0f} GB of the disk are free.", err=True)


def end_badly(logs: Sequence[str], targets: Sequence[str]) -> None:
    """Say which rule failed, by Snakemake's logs of the run, and what that rule said last."""
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
