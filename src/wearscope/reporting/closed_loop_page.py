"""The page of a closed loop: what the model lacked, the errors before and after, and how sure that is."""

from pathlib import Path

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope import tables
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
from wearscope.reporting.figures.closed_loop import (
    draw_errors,
    draw_residual_against,
    draw_residual_over_time,
)
from wearscope.reporting.next_measurement import describe_measurements
from wearscope.reporting.page import Section, badge, embed_figure, render_page, render_table


def write_closed_loop_page(folder: str | Path) -> None:
    """Write ``report.html`` beside the files of a closed loop.

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
        Section("Errors on the test runs", _errors(loop), "errors"),
        Section("Residual", _residual(loop), "residual"),
        Section("Candidates", describe_candidates(loop), "candidates"),
        Section("Which effects the runs separate", describe_isolability(loop), "isolability"),
        Section("Simulated forward", describe_forward(loop), "forward"),
        Section("What is left unnamed", describe_rest(loop), "unnamed"),
        Section("Not determined, and which motion would help", describe_undetermined(loop), "undetermined"),
        Section("The next measurement", describe_measurements(loop.verdict), "next-measurement"),
        Section("Notes", describe_notes(loop), "notes"),
    ]
    title = f"Closed loop: {loop.verdict['dataset']}"
    return render_page(title, [s for s in sections if s.body], tell_size(loop), tell_version(loop))


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
    relative = [
        (joint, run, number(values[0]), number(values[1]))
        for joint, one in loop.verdict["joints"].items()
        for run, values in one.get("relative_error_percent", {}).items()
    ]
    table = pd.DataFrame(relative, columns=["joint", "test run", "before [%]", "after [%]"])
    # As objects: a column of strings would forget that these are HTML.
    table["error"] = pd.Series([_change(*values) for _, _, *values in relative], dtype=object)
    caption = (
        "RMS error on the test runs at the common bandwidth, each joint on its own scale, with 95 % "
        "intervals from resampled blocks. Before: the declared model, its own parameters refitted on "
        "the training runs."
    )
    if loop.black_box is not None:
        caption += " Diamonds: what gradient-boosted trees on all signals leave of the same residual."
    rest = Markup("<details{}><summary>Relative error of every test run</summary>{}</details>").format(
        Markup(" open") if len(relative) <= MOST_SHOWN else "",
        render_table(table, "100 |residual| / |torque| over the rows that count."),
    )
    alt = "RMS error by joint: " + "; ".join(
        f"{r['joint']} before {r['before (95 %)']}, after {r['after (95 %)']} {r['unit']}" for r in records
    )
    return Markup("{}{}{}").format(
        embed_figure(draw_errors(loop), alt, caption), render_table(pd.DataFrame(records)), rest
    )


def _change(before: float, after: float) -> Markup:
    if not np.isfinite([before, after]).all() or abs(after - before) < 1e-9 * max(before, 1.0):
        return badge("same")
    return badge("smaller", "good") if after < before else badge("larger", "bad")


def _residual(loop: ClosedLoop) -> Markup:
    parts = [Markup("")]
    for joint in loop.shown():
        parts.append(Markup("<h3>{}</h3>").format(joint))
        parts.append(
            embed_figure(
                draw_residual_over_time(loop, joint),
                f"Residual torque of {joint} over time on the test runs, before and after",
                "Residual on the test runs, before and after.",
            )
        )
        against = draw_residual_against(loop, joint)
        if against is not None:
            parts.append(
                embed_figure(
                    against,
                    f"Residual torque of {joint} against the signals that it depends on, before and after",
                    "Residual on all runs against the signals that the verdict names, then those that the "
                    "residual before depends on most; lines join medians of bins.",
                    "png",
                )
            )
    return Markup("").join(parts) + _dependence(loop) + _diagnostics(loop)


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
        )
    )
