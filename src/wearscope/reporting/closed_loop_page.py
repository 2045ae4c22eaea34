"""The page of a closed loop: what the model lacked, the errors before and after, and how sure that is."""

from pathlib import Path

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope import tables
from wearscope.reporting.charts.loop import chart_against, chart_errors, chart_residual, chart_torque
from wearscope.reporting.charts.loop_data import loop_filters, loop_labels, loop_tables
from wearscope.reporting.closed_loop import (
    STAGES,
    ClosedLoop,
    bounded,
    gap_closed,
    number,
    read_closed_loop,
)
from wearscope.reporting.closed_loop_details import (
    MOST_SHOWN,
    describe_candidates,
    describe_forward,
    describe_isolability,
    describe_notes,
    describe_rest,
    describe_undetermined,
    say_missing,
    write_value,
)
from wearscope.reporting.closed_loop_outcome import describe_outcome, tell_size, tell_version
from wearscope.reporting.next_measurement import describe_measurements
from wearscope.reporting.page import Section, badge, embed_chart, render_page, render_table
from wearscope.reporting.strips import loop_strip

#: Column of the joint, and the filter that it follows.
_JOINT = {"joint": "joint"}


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
    sections = [
        Section("Outcome", describe_outcome(loop), "outcome"),
        Section("The next measurement", describe_measurements(loop.verdict), "next-measurement"),
        Section("Errors on the test runs", _errors(loop), "errors"),
        Section("Residual", _residual(loop), "residual"),
        Section("Candidates", describe_candidates(loop), "candidates"),
        Section("Which effects the runs separate", describe_isolability(loop), "isolability"),
        Section("Simulated forward", describe_forward(loop), "forward"),
        Section("What is left unnamed", describe_rest(loop), "unnamed"),
        Section("Not determined, and which motion would help", describe_undetermined(loop), "undetermined"),
        Section("Notes", describe_notes(loop), "notes"),
    ]
    title = f"Diagnosis of {loop.verdict['dataset']}"
    return render_page(
        title,
        [section for section in sections if section.body],
        tell_size(loop),
        tell_version(loop),
        loop_filters(loop),
        loop_tables(loop),
        loop_labels(loop),
        loop_strip(loop),
    )


def _errors(loop: ClosedLoop) -> Markup:
    records = []
    for joint, one in loop.verdict["joints"].items():
        record = {"joint": joint, "unit": one["unit"], "as declared": number(one.get("rms_as_declared"))}
        for stage in STAGES:
            value = number(one.get(f"rms_{stage}"))
            record[f"{stage} (95 %)"] = bounded(value, one.get(f"rms_{stage}_ci95"), write_value)
        record["noise floor"] = number(one.get("noise_floor"))
        record["gap closed"] = gap_closed(one)[1]
        records.append(record)
    relative = []
    for joint, one in loop.verdict["joints"].items():
        for run, values in one.get("relative_error_percent", {}).items():
            before, after = (number(value) for value in values)
            row = {"joint": joint, "test run": run, "before [%]": before, "after [%]": after}
            relative.append(row | {"error": _change(before, after)})
    rest = Markup("<details{}><summary>Relative error of every test run</summary>{}</details>").format(
        Markup(" open") if len(relative) <= MOST_SHOWN else "",
        render_table(
            relative,
            "100 |residual| / |torque| over the rows that count.",
            filter_by=_JOINT | {"test run": "run"},
        ),
    )
    return Markup("{}{}{}").format(
        embed_chart(chart_errors(loop)), render_table(pd.DataFrame(records), filter_by=_JOINT), rest
    )


def _change(before: float, after: float) -> Markup:
    if not np.isfinite([before, after]).all() or abs(after - before) < 1e-9 * max(before, 1.0):
        return badge("same")
    return badge("smaller", "good") if after < before else badge("larger", "bad")


def _residual(loop: ClosedLoop) -> Markup:
    """Charts of torque and residual, dependence and diagnostics."""
    joint = loop.foremost()
    runs = loop.residual.loc[loop.residual["use"] == "test", "run"]
    run = str(runs.iloc[0]) if len(runs) else ""
    charts = [chart_torque(loop, joint, run), chart_residual(loop, joint, run), chart_against(loop, joint)]
    shown = Markup("").join(embed_chart(chart) for chart in charts if chart is not None)
    return shown + _dependence(loop) + _diagnostics(loop)


def _dependence(loop: ClosedLoop) -> Markup:
    if loop.dependence is None:
        return say_missing("Which signals the residuals depend on")
    records = []
    for (joint, stage), rows in loop.dependence.groupby(["joint", "stage"], sort=False):
        sure = rows[(rows["p_adjusted"] <= 0.05) & (rows["share_held_out"] > 0.0)]
        best = sure.sort_values(["share_held_out", "signal"], ascending=[False, True]).head(4)
        said = [f"{row.signal} ({100 * row.share_held_out:.0f} %)" for row in best.itertuples()]
        records.append({"joint": joint, "stage": stage, "signals": "; ".join(said) or "none"})
    table = pd.DataFrame(records).pivot(index="joint", columns="stage", values="signals")
    table = table.reindex([joint for joint in loop.joints if joint in table.index])
    table = table[["before", "after"]].reset_index()
    return Markup("<h3>Dependence, whatever its form</h3>{}").format(
        render_table(
            table,
            "Signals on which a spline explains held-out residual of the training runs (share of the "
            "joint's variance; above 100 % where other joints gain too by inertial parameters that it "
            "frees), adjusted p at most 0.05 by random signs of blocks; at most four.",
            filter_by=_JOINT,
        )
    )


def _diagnostics(loop: ClosedLoop) -> Markup:
    if loop.diagnostics is None:
        return say_missing("The residuals' spectrum and whiteness")
    table = loop.diagnostics.rename(
        columns={
            "relative_error": "relative error [%]",
            "peak": "largest at [Hz]",
            "bandwidth": "90 % below [Hz]",
            "lag_correlation": "correlation",
            "ljung_box_p": "Ljung-Box p",
        }
    )
    return Markup(
        "<details><summary>Size, spectrum and whiteness of every residual</summary>{}</details>"
    ).format(
        render_table(
            table,
            "Correlation: of neighbouring samples, thinned so that white noise would show almost none; "
            "a small Ljung-Box p says that the residual is not white.",
            filter_by=_JOINT | {"run": "run"},
        )
    )
