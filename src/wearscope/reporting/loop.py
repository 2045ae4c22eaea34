"""The closed loop's outcome in short: what was named, and the errors before and after."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from wearscope.reporting.labels import UNKNOWN, join_words, unit_text
from wearscope.reporting.page import format_number
from wearscope.reporting.style import AFTER, BEFORE, figure_style, new_figure


@dataclass(frozen=True)
class StatusWords:
    """What a status is called.

    Attributes
    ----------
    heading : str
        Of a group of effects.
    sentence : str
        Start of a sentence on one effect.
    """

    heading: str
    sentence: str


#: What the test runs say of an effect, in the order in which it is told.
STATUSES = {
    "refuted": StatusWords("Refuted by the test runs", "The test runs refute it"),
    "confirmed": StatusWords("Confirmed by the test runs", "The test runs confirm it"),
    "not_confirmed": StatusWords("Not confirmed", "The test runs neither confirm nor refute it"),
}


def tell_status(entry: Mapping[str, Any]) -> str:
    """Start of a sentence: what the test runs say of an effect."""
    return STATUSES[entry["status"]].sentence


def say_share(entry: Mapping[str, Any]) -> str:
    """Share of the residual variance that an effect removes on the test runs, with its 95 % interval."""
    share = _number(entry["error_reduction"])
    low, high = (_number(value) for value in entry["error_reduction_ci95"])
    if not np.isfinite(share):
        return "it removes an unknown share of the residual variance"
    if share < 0.0:
        return f"it adds {_percent(-share, -high, -low)} to the residual variance"
    return f"it removes {_percent(share, low, high)} of the residual variance"


def _percent(share: float, low: float, high: float) -> str:
    """``48 % (95 %: 36 to 55)``, with a digit more where the share is small."""
    digits = 0 if abs(share) >= 0.095 else 1
    share, low, high = (round(100 * value, digits) + 0.0 for value in (share, low, high))
    text = f"{share:.{digits}f} % (95 %: {low:.{digits}f} to {high:.{digits}f})"
    return text.replace("-", "\N{MINUS SIGN}").replace("nan", "n/a")


def verdict_sentences(verdict: Mapping[str, Any], planted: Mapping[str, Any] | None = None) -> list[str]:
    """What ``verdict.json`` says in words, and, where it is known, whether that is what was planted."""
    entries = verdict["verdict"]
    order = list(STATUSES)
    sentences = [
        _entry_sentence(entry) for entry in sorted(entries, key=lambda entry: order.index(entry["status"]))
    ]
    sentences += _rest_sentences(verdict)
    if planted is not None:
        sentences.append(_truth_sentence(entries, planted))
    return sentences


def _rest_sentences(verdict: Mapping[str, Any]) -> list[str]:
    """What is left unexplained, and why the search stopped; that nothing was added where nothing is left."""
    sentences = []
    for name, joint in verdict["joints"].items():
        if joint["state"] == "unexplained":
            on = joint["depends_on"]
            depends = f", depending on {join_words(on)}" if on else ""
            size = f"{format_number(_number(joint['unexplained_rms']))} {joint['unit']}"
            sentences.append(f"Unexplained on {name}: {size} RMS{depends}.")
        elif joint["state"] == "not_judged":
            sentences.append(f"Not judged on {name}: {joint['reason']}.")
    if not verdict["verdict"] and not sentences:
        sentences.append("None: the declared model suffices, no effect was added.")
    elif not verdict["verdict"]:
        unexplained = any(joint["state"] == "unexplained" for joint in verdict["joints"].values())
        also = ", and the declared model does not suffice" if unexplained else ""
        sentences.insert(0, f"No effect was named{also}.")
    return sentences + [f"{text}." for text in verdict["stopped"]]


def _entry_sentence(entry: Mapping[str, Any]) -> str:
    depends = join_words([str(one) for one in entry["depends_on"]])
    if entry["effect"] == UNKNOWN:
        text = f"Unknown on {entry['joint']}: structure that no named effect explains"
    else:
        text = f"{entry['effect']} on {entry['joint']}"
    if depends:
        text += f", depending on {depends}"
    status = tell_status(entry)
    text += f". {status}: {say_share(entry)}{_parameter_text(entry)}"
    if entry["equivalent"]:
        text += f". It cannot be told from {join_words(entry['equivalent'], 'or')} on these runs"
    return text + "."


def _parameter_text(entry: Mapping[str, Any]) -> str:
    """`` (stiffness 7,683 N m/rad, 95 % 5,913 to 9,454)``; nothing without parameters."""
    parts = []
    for name, one in entry.get("parameters", {}).items():
        low, high = (format_number(_number(value)) for value in one["ci95"])
        value = " ".join([name, format_number(_number(one["value"])), unit_text(one.get("unit", ""))]).strip()
        parts.append(f"{value}, 95 % {low} to {high}")
    return f" ({'; '.join(parts)})" if parts else ""


def _truth_sentence(entries: list[Mapping[str, Any]], planted: Mapping[str, Any]) -> str:
    wanted = planted.get("planted", [])
    if not wanted:
        return "Nothing was planted: " + ("so it should be." if not entries else "a false alarm.")
    parts, right = [], []
    for one in wanted:
        accepted = set(one.get("accepted") or [one["effect"]])
        hits = [
            entry
            for entry in entries
            if entry["joint"] == one["joint"] and accepted & {entry["effect"], *entry.get("equivalent", [])}
        ]
        right += hits
        parts.append(f"{one['effect']} on {one['joint']}, which it {'found' if hits else 'did not find'}")
    wrong = [f"{entry['effect']} on {entry['joint']}" for entry in entries if entry not in right]
    tail = f" It named what was not planted: {join_words(wrong)}." if wrong else ""
    return f"Planted was {join_words(parts)}.{tail}"


def joint_table(verdict: Mapping[str, Any]) -> pd.DataFrame:
    """RMS error of every joint on the test runs, with the noise floor; NaN where a number is missing.

    Columns ``as declared`` and ``simulated after`` (the corrected model simulated forward) only where the
    verdict has them.
    """
    records = []
    for joint, one in verdict["joints"].items():
        before, after = _number(one.get("rms_before")), _number(one.get("rms_after"))
        forward = verdict.get("forward", {}).get(joint, {}).get("after", {})
        records.append(
            {
                "joint": joint,
                "unit": one.get("unit", ""),
                "as declared": _number(one.get("rms_as_declared")),
                "RMS before": before,
                "RMS after": after,
                "change [%]": _change(before, after),
                "simulated after": _number(forward.get("torque_rms")),
                "noise floor": _number(one.get("noise_floor")),
            }
        )
    table = pd.DataFrame(records)
    absent = [name for name in ("as declared", "simulated after") if table[name].isna().all()]
    return table.drop(columns=absent)


def _change(before: float, after: float) -> float:
    """Change in percent, without what is rounding alone."""
    if not before > 0:
        return np.nan
    return 0.0 if np.isclose(before, after, rtol=1e-9) else 100 * (after / before - 1)


def _number(value: Any) -> float:
    return np.nan if value is None else float(value)


def draw_loop(verdict: Mapping[str, Any]) -> Figure:
    """Error of every joint before and after with 95 % intervals, and its noise floor."""
    table = joint_table(verdict)
    place = np.arange(len(table), dtype=float)
    before, after = (table[f"RMS {stage}"].to_numpy(dtype=float) for stage in ("before", "after"))
    with figure_style():
        figure = new_figure(7.5, 1.1 + 0.38 * len(table))
        ax = figure.subplots()
        ax.hlines(place, before, after, color="#bbbbbb", lw=1.2, zorder=1)
        stages = ((-0.09, "before", before, BEFORE), (0.09, "after", after, AFTER))
        for shift, stage, values, colour in stages:
            for y, one in zip(place + shift, verdict["joints"].values(), strict=True):
                low, high = (_number(value) for value in one.get(f"rms_{stage}_ci95") or (None, None))
                ax.plot([low, high], [y, y], color=colour, lw=2.2, alpha=0.45)
            ax.plot(values, place + shift, "o", color=colour, label=stage)
        if "simulated after" in table:
            (diamonds,) = ax.plot(table["simulated after"], place + 0.27, "D", mfc="none", mec=AFTER, ms=4.5)
            diamonds.set_label("after, simulated forward")
        floor = table["noise floor"].to_numpy(dtype=float)
        if np.isfinite(floor).any():
            ax.vlines(floor, place - 0.3, place + 0.3, color="black", lw=1.8, label="noise floor")
        shown = np.concatenate([before, after, floor])
        shown = shown[np.isfinite(shown) & (shown > 0)]
        if shown.size and shown.max() > 20 * shown.min():
            ax.set_xscale("log")
            ax.xaxis.set_major_formatter("{x:g}")
        else:
            ax.set_xlim(left=0)
        ticks = [
            name if np.isfinite(one) else f"{name} (no noise floor)"
            for name, one in zip(table["joint"], floor, strict=True)
        ]
        ax.set_yticks(place, ticks)
        ax.set_ylim(len(table) - 0.5, -0.5)
        ax.set_xlabel(f"RMS error on test runs [{join_words(sorted(set(table['unit'])))}]")
        ax.grid(axis="x")
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4)
    return figure
