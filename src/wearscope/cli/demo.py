"""A verdict on the data set that ships with the package, in seconds."""

from pathlib import Path

import click

from wearscope.cli.progress import say


@click.command()
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("results/demo"),
    show_default=True,
    help="Folder of the page and the models.",
)
@click.option("--open", "opened", is_flag=True, help="Open the page in the browser.")
def demo(out, opened):  # type: ignore[no-untyped-def]
    """Diagnose an arm whose recordings come along: what its model lacks, and the error after.

    \b
    Example:
      wearscope demo --open
    """
    from wearscope.cli.ending import show_result
    from wearscope.closed_loop.run import close_loop
    from wearscope.home import example_dataset
    from wearscope.reporting.closed_loop_page import write_closed_loop_page

    say("Comparing four recordings of an arm with its model ...", err=True)
    close_loop(example_dataset(), out, light=True)
    write_closed_loop_page(out, example_dataset() / "robot.urdf")
    show_result(out / "report.html", opened)
