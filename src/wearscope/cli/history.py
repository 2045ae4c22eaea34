"""All answers of a folder, newest first."""

from pathlib import Path

import click

from wearscope.cli.progress import say
from wearscope.errors import InputError


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
    from wearscope.cli.show import print_table
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
