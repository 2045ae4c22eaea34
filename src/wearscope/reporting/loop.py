"""The closed loop's outcome in short: what was named, and the errors before and after."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from wearscope.reporting.labels import join_words
from wearscope.reporting.page import format_number
from wearscope.reporting.style import AFTER, BEFORE, figure_style, new_figure


def verdict_sentences(verdict: Mapping[str, Any], planted: Mapping[str, Any] | None = None) -> list[str]:
    """What ``verdict.json`` says in words, and, where it is known, whether that is what was planted."""
    entries = verdict["verdict"]
    if not entries:
        sentences = ["None: the declared model suffices, no effect was added."]
    else:
        sentences = [_entry_sentence(entry) for entry in entries]
    if planted is not None:
        sentences.append(_truth_sentence(entries, planted))
    return sentences


def _entry_sentence(entry: Mapping[str, Any]) -> str:
    share = entry.get("error_reduction")
    removed = "an unknown share" if share is None else f"{100 * share:.0f} %"
    depends = join_words([str(one) for one in entry.get("depends_on", [])])
    if entry["effect"] == "unknown":
        text = f"Unknown on {entry['joint']}: structure that no named effect explains"
    else:
        text = f"{entry['effect']} on {entry['joint']}"
    if depends:
        text += f", depending on {depends}"
    text += f", removes {removed} of the held-out residual variance"
    if entry.get("equivalent"):
        text += f"; these runs cannot tell it from {join_words(entry['equivalent'], 'or')}"
    return text + "."


def _truth_sentence(entries: list[Mapping[str, Any]], planted: Mapping[str, Any]) -> str:
    wanted = planted.get("planted", [])
    if not wanted:
        return "Nothing was planted: " + ("so it should be." if not entries else "a false alarm.")
    found = {(one["joint"], name) for one in entries for name in (one["effect"], *one.get("equivalent", []))}
    parts = []
    for one in wanted:
        right = any((one["joint"], name) in found for name in one.get("accepted") or [one["effect"]])
        parts.append(f"{one['effect']} on {one['joint']}, which it {'found' if right else 'did not find'}")
    extra = len(entries) - len(wanted)
    tail = f" It named {extra} more than was planted." if extra > 0 else ""
    return f"Planted was {join_words(parts)}.{tail}"


def joint_table(verdict: Mapping[str, Any]) -> pd.DataFrame:
    """RMS error of every joint on the test runs before and after, with the noise floor."""
    records = []
    for joint, one in verdict["joints"].items():
        before, after = _number(one.get("rms_before")), _number(one.get("rms_after"))
        records.append(
            {
                "joint": joint,
                "unit": one.get("unit", ""),
                "RMS before": before,
                "RMS after": after,
                "change [%]": 100 * (after / before - 1) if before > 0 else np.nan,
                "noise floor": _number(one.get("noise_floor")),
            }
        )
    return pd.DataFrame(records)


def _number(value: Any) -> float:
    return np.nan if value is None else float(value)


def draw_loop(verdict: Mapping[str, Any]) -> Figure:
    """Error of every joint before and after, and its noise floor."""
    table = joint_table(verdict)
    place = np.arange(len(table))
    with figure_style():
        figure = new_figure(max(4.5, 1.2 + 0.9 * len(table)), 2.9)
        ax = figure.subplots()
        for shift, column, colour in ((-0.2, "RMS before", BEFORE), (0.2, "RMS after", AFTER)):
            values = table[column].to_numpy(dtype=float)
            ax.bar(place + shift, np.nan_to_num(values), 0.38, color=colour, label=column.split()[1])
            for x, value in zip(place + shift, values, strict=True):
                ax.text(
                    x, np.nan_to_num(value), format_number(value, 2), ha="center", va="bottom", fontsize=7
                )
        floor = table["noise floor"].to_numpy(dtype=float)
        known = np.isfinite(floor)
        if known.any():
            ends = place[known] - 0.42, place[known] + 0.42
            ax.hlines(floor[known], *ends, color="black", lw=1.5, label="noise floor")
        missing = "" if known.all() else "\n(no noise floor)"
        ticks = [name if one else name + missing for name, one in zip(table["joint"], known, strict=True)]
        ax.set_xticks(place, ticks)
        units = join_words(sorted(set(table["unit"])))
        ax.set_ylabel(f"RMS error on test runs [{units}]")
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
    return figure
