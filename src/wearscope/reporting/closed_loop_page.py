"""The page of a closed loop: what the model lacked, the errors before and after, and how sure that is."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope import tables
from wearscope.effects.vocabulary import list_effects
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
    list_items,
    say_missing,
    write_value,
)
from wearscope.reporting.figures.closed_loop import (
    draw_errors,
    draw_residual_against,
    draw_residual_over_time,
)
from wearscope.reporting.labels import UNKNOWN, count_text, join_words, unit_text
from wearscope.reporting.page import Section, badge, embed_figure, render_page, render_table, unbreak


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
        Section("Outcome", _outcome(loop), "outcome"),
        Section("Errors on the test runs", _errors(loop), "errors"),
        Section("Residual", _residual(loop), "residual"),
        Section("Candidates", describe_candidates(loop), "candidates"),
        Section("Which effects the runs separate", describe_isolability(loop), "isolability"),
        Section("Simulated forward", describe_forward(loop), "forward"),
        Section("What is left unnamed", describe_rest(loop), "unnamed"),
        Section("Not determined, and which motion would help", describe_undetermined(loop), "undetermined"),
        Section("Notes", describe_notes(loop), "notes"),
    ]
    runs = loop.residual.groupby("use")["run"].nunique()
    subtitle = (
        f"{count_text(len(loop.joints), 'joint')}, {count_text(int(runs.get('train', 0)), 'training run')}, "
        f"{count_text(int(runs.get('test', 0)), 'test run')}. Parameters and choices come from the training "
        "runs, errors from the test runs."
    )
    title = f"Closed loop: {loop.verdict['dataset']}"
    return render_page(title, [s for s in sections if s.body], subtitle, "Made by wearscope from its tables.")


def _outcome(loop: ClosedLoop) -> Markup:
    rows = [_joint_outcome(loop, joint) for joint in loop.joints]
    lead = Markup("")
    if not loop.verdict["verdict"]:
        lead = Markup('<div class="notice">{}</div>').format(
            "None: the declared model suffices. No candidate beat it outside the noise, and no further "
            "structure was found; the model after is the model before."
        )
    forward = loop.verdict.get("forward", {})
    failed = sorted(
        {one["outcome"] for joint in forward.values() for one in joint.values() if one["outcome"] != "ok"}
    )
    alarm = Markup("").join(
        Markup('<div class="alarm">Forward simulation: {}</div>').format(text) for text in failed
    )
    return Markup("{}{}{}{}").format(alarm, lead, list_items(rows), _parameters(loop))


def _joint_outcome(loop: ClosedLoop, joint: str) -> Markup:
    one = loop.verdict["joints"][joint]
    before, after = number(one.get("rms_before")), number(one.get("rms_after"))
    floor = number(one.get("noise_floor"))
    if abs(after - before) <= 1e-6 * before:
        told = f", noise floor {write_value(floor)}" if np.isfinite(floor) else ""
        change = Markup(" RMS error {} {}{}.").format(write_value(before), one["unit"], told)
    else:
        gap = gap_closed(one)[1]
        told = f", {gap} of the gap to the noise floor closed" if gap.endswith("%") else ""
        change = Markup(" RMS error {} → {} {}{}.").format(
            write_value(before), write_value(after), one["unit"], unbreak(told)
        )
    entries = loop.entries_at(joint)
    if not np.isfinite(before):
        return Markup("<strong>{}</strong>: {} it does not move on the test runs.").format(
            joint, badge("not judged")
        )
    if not entries:
        shared = {effect.name for effect in list_effects() if effect.per_robot}
        felt = [e["effect"] for e in loop.verdict["verdict"] if e["effect"] in shared]
        text = f"nothing added here, but {join_words(felt)} acts on it too." if felt else "nothing added."
        return Markup("<strong>{}</strong>: {} {}{}").format(joint, badge("none"), text, change)
    said = Markup("; ").join(_describe(entry) for entry in entries)
    return Markup("<strong>{}</strong>: {}.{}").format(joint, said, change)


def _describe(entry: Mapping[str, Any]) -> Markup:
    share = entry.get("error_reduction")
    removed = "an unknown share" if share is None else f"{100 * share:.0f} %"
    unknown = entry["effect"] == UNKNOWN
    label = badge(entry["effect"], "unsure" if unknown else "good")
    text = Markup(" structure that no named effect explains") if unknown else Markup("")
    depends = join_words(entry.get("depends_on", []))
    if depends:
        text += Markup(", depending on {}").format(depends)
    text += Markup(", removes {} of the held-out residual variance").format(unbreak(removed))
    if share is not None and share < 0:
        text += Markup(" ({})").format(badge("makes it larger", "bad"))
    if entry.get("equivalent"):
        text += Markup("; {} {}").format(
            badge("equivalent", "unsure"),
            f"these runs cannot tell it from {join_words(entry['equivalent'], 'or')}",
        )
    return Markup("{}{}").format(label, text)


def _parameters(loop: ClosedLoop) -> Markup:
    records = []
    for entry in loop.verdict["verdict"]:
        parameters = dict(entry.get("parameters", {}))
        heights = [one["value"] for name, one in parameters.items() if name.startswith("height")]
        if entry["effect"] == UNKNOWN and heights:
            records.append(
                {
                    "joint": entry["joint"],
                    "effect": UNKNOWN,
                    "parameter": f"{len(heights)} heights of a spline",
                    "value": f"{write_value(min(heights))} to {write_value(max(heights))}",
                    "95 % interval": "n/a",
                    "unit": next(iter(parameters.values())).get("unit", ""),
                }
            )
            continue
        for name, one in parameters.items():
            low, high = (number(v) for v in one["ci95"])
            records.append(
                {
                    "joint": entry["joint"],
                    "effect": entry["effect"],
                    "parameter": name,
                    "value": write_value(number(one["value"])),
                    "95 % interval": f"{write_value(low)} to {write_value(high)}",
                    "unit": unit_text(one.get("unit", "")),
                }
            )
        for name, value in entry.get("fixed", {}).items():
            records.append(
                {
                    "joint": entry["joint"],
                    "effect": entry["effect"],
                    "parameter": name,
                    "value": write_value(number(value)),
                    "95 % interval": "fixed",
                    "unit": "",
                }
            )
    if not records:
        return Markup("")
    return render_table(pd.DataFrame(records), "Parameters of what was added; the models hold them all.")


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
            "Signals on which a spline explains held-out residual (share of its variance), adjusted p "
            "at most 0.05 by random signs of blocks; at most four.",
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
