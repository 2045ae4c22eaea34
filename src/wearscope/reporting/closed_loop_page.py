"""The page of a closed loop: what the model lacked, the errors before and after, and how sure that is."""

from pathlib import Path

from wearscope import tables
from wearscope.reporting.charts.loop_data import loop_filters, loop_labels, loop_tables
from wearscope.reporting.closed_loop import ClosedLoop, read_closed_loop
from wearscope.reporting.labels import count_text
from wearscope.reporting.page import render_page
from wearscope.reporting.sections.base import LoopSection
from wearscope.reporting.sections.loop import (
    Candidates,
    Errors,
    Forward,
    Notes,
    Residual,
    Undetermined,
)
from wearscope.reporting.sections.loop_outcome import Events, NextMeasurement, Outcome
from wearscope.reporting.strips import loop_strip

SECTIONS: tuple[type[LoopSection], ...] = (
    Outcome, NextMeasurement, Errors, Events, Residual, Candidates, Forward, Undetermined, Notes,
)  # fmt: skip


def write_closed_loop_page(folder: str | Path) -> None:
    """Write ``report.html`` next to the files of a closed loop.

    Raises
    ------
    InputError
        Where the loop was not closed in that folder.
    """
    tables.write_text(Path(folder) / "report.html", render_closed_loop(read_closed_loop(folder)))


def render_closed_loop(loop: ClosedLoop) -> str:
    """Page of a closed loop, with nothing from elsewhere."""
    runs = loop.residual.groupby("use")["run"].nunique()
    return render_page(
        f"Diagnosis of {loop.verdict['dataset']}",
        [section(loop).render() for section in SECTIONS],
        f"{count_text(len(loop.joints), 'joint')}, {count_text(int(runs.get('train', 0)), 'training run')}, "
        f"{count_text(int(runs.get('test', 0)), 'test run')}. Parameters and choices come from the training "
        "runs, errors from the test runs.",
        f"Made from the tables of a loop closed by wearscope {loop.verdict['version']}.",
        loop_filters(loop),
        loop_tables(loop),
        loop_labels(loop),
        loop_strip(loop),
    )
