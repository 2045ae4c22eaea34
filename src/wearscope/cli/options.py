"""Options that several commands share."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

_SHARED = (
    click.option("--cores", type=click.IntRange(1), help="Cores to use; all there are where left out."),
    click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="KEY=VALUE",
        help="Change a setting for this once: seed=2, snr.runs=1000.",
    ),
    click.option("--dry-run", "-n", is_flag=True, help="Say what would be done."),
    click.option(
        "--snakefile",
        type=click.Path(exists=True, dir_okay=False, path_type=Path),
        help="Own workflow in place of the platform's; its code runs.",
    ),
    click.option("--verbose", "-v", is_flag=True, help="Show all that Snakemake says."),
)
study_argument = click.argument("study", required=False)


def workflow_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of the commands that call Snakemake."""
    for option in reversed(_SHARED):
        command = option(command)
    return command
