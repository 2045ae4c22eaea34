"""Lines on the terminal."""

import click

from wearscope.errors import escape_text


def say(line: object, err: bool = False, bold: bool = False) -> None:
    """Print a line in which no text of a file, and no path, can steer the terminal."""
    click.echo(click.style(escape_text(str(line)), bold=bold or None, reset=bold), err=err)
