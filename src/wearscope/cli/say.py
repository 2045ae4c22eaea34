"""Lines on the terminal."""

from collections.abc import Iterable
from typing import Any

import click

from wearscope.errors import escape_text


def say(line: object, err: bool = False) -> None:
    """Print a line in which no text of a file, and no path, can steer the terminal."""
    click.echo(escape_text(str(line)), err=err)


def say_styled(parts: Iterable[tuple[str, dict[str, Any]]]) -> None:
    """Print a line of texts, each in the style that `click.style` takes; plain where there is no terminal."""
    click.echo("".join(click.style(escape_text(text), **style) for text, style in parts))
