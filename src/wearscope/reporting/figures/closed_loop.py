"""Figures of a closed loop: errors, residuals, candidates, isolability, forward simulation."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from wearscope.reporting.closed_loop import (
    STAGES,
    ClosedLoop,
    against_signal,
    dominant_signals,
    number,
    split_signal,
)
from wearscope.reporting.figures.heat import draw_heat
from wearscope.reporting.page import format_number
from wearscope.reporting.style import AFTER, BEFORE, PALETTE, figure_style, new_figure

COLOURS = {"before": BEFORE, "after": AFTER}
_POINTS = 1500
_BINS = 24
_SIGNAL_NAMES = {
    "q": ("position", "{position}"),
    "qd": ("speed", "{position}/s"),
    "qdd": ("acceleration", "{position}/s²"),
    "load": ("rigid-body torque", "{torque}"),
    "temp": ("temperature", "°C"),
}


def draw_errors(loop: ClosedLoop) -> Figure:
    """RMS error of every joint on the test runs, each on its own scale, with intervals and noise floor."""
    joints = loop.joints
    across = min(len(joints), 6)
    down = -(-len(joints) // across)
    with figure_style():
        figure = new_figure(max(6.0, 1.75 * across + 0.5), 2.7 * down + 0.4)
        axes = np.atleast_1d(figure.subplots(down, across, squeeze=False)).ravel()
        for ax, joint in zip(axes, joints, strict=False):
            _draw_joint_errors(ax, loop, joint)
        for ax in axes[len(joints) :]:
            ax.axis("off")
        handles = [axes[0].bar([0], [0], color=COLOURS[stage], label=stage, width=0.0) for stage in STAGES]
        handles += axes[0].plot([], [], "D", color=PALETTE[2], ms=5, label="what a black box leaves of it")
        handles += axes[0].plot([], [], "-", color="black", lw=1.5, label="noise floor")
        figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return figure


def _draw_joint_errors(ax: Axes, loop: ClosedLoop, joint: str) -> None:
    one = loop.verdict["joints"][joint]
    for x, stage in enumerate(STAGES):
        value = number(one.get(f"rms_{stage}"))
        if not np.isfinite(value):
            ax.text(x, 0.5, "n/a", ha="center", transform=ax.get_xaxis_transform())
            continue
        interval = [number(v) for v in one.get(f"rms_{stage}_ci95") or (None, None)]
        ax.bar([x], [value], 0.7, color=COLOURS[stage])
        if np.isfinite(interval).all():
            ax.plot([x, x], interval, color="black", lw=1.0)
        top = np.nanmax([value, *interval])
        ax.text(x - 0.14, top, format_number(value), ha="center", va="bottom", fontsize=7.5)
        if loop.black_box is not None:
            row = loop.black_box[(loop.black_box["joint"] == joint) & (loop.black_box["stage"] == stage)]
            if len(row) and np.isfinite(row["rms_black_box"].iloc[0]):
                left = row.iloc[0]
                ax.plot(
                    [x + 0.2] * 2, [left["rms_black_box_low"], left["rms_black_box_high"]], color=PALETTE[2]
                )
                ax.plot([x + 0.2], [left["rms_black_box"]], "D", color=PALETTE[2], ms=5, mec="white", mew=0.6)
    floor = number(one.get("noise_floor"))
    if np.isfinite(floor):
        ax.axhline(floor, color="black", lw=1.5)
    ax.set_xticks([0, 1], STAGES)
    ax.set_xlim(-0.6, 1.6)
    ax.margins(y=0.12)
    ax.set_ylim(bottom=0.0)
    ax.set_title(joint)
    ax.set_ylabel(f"RMS error [{one['unit']}]" + ("" if np.isfinite(floor) else "\n(no noise floor)"))


def thin(count: int, most: int = _POINTS) -> slice:
    """Every so many rows, at most `most` of `count`."""
    return slice(None, None, max(1, -(-count // most)))


def _draw_over_time(ax: Axes, rows: pd.DataFrame, errors: dict[str, np.ndarray]) -> None:
    """Lines over time of both stages' errors by label, where rows count; "n/a" where none does."""
    counts = rows["counts"].to_numpy(dtype=bool)
    for stage, (label, error) in zip(STAGES, errors.items(), strict=True):
        shown = np.where(counts, error, np.nan)
        ax.plot(rows["t"], shown, color=COLOURS[stage], lw=0.9, label=label)
        if not np.isfinite(shown).any():
            ax.text(0.5, 0.5, "n/a", transform=ax.transAxes, ha="center")
    ax.axhline(0.0, color="#999999", lw=0.6, zorder=0)
    ax.margins(x=0.0)


def draw_residual_over_time(loop: ClosedLoop, joint: str) -> Figure:
    """Residual of a joint along each test run, before and after, with rows that do not count left out."""
    own = loop.residual[(loop.residual["joint"] == joint) & (loop.residual["use"] == "test")]
    runs = list(dict.fromkeys(own["run"]))[:3]
    unit = loop.verdict["joints"][joint]["unit"]
    with figure_style():
        figure = new_figure(10.0, 1.9 * len(runs) + 0.5)
        axes = np.atleast_1d(figure.subplots(len(runs), 1, squeeze=False)).ravel()
        for ax, run in zip(axes, runs, strict=True):
            rows = own[own["run"] == run]
            rows = rows.iloc[thin(len(rows))]
            errors = {stage: rows[f"residual_{stage}"].to_numpy() for stage in STAGES}
            _draw_over_time(ax, rows, errors)
            ax.set_title(f"{joint}, {run}")
            ax.set_ylabel(f"residual [{unit}]")
        axes[-1].set_xlabel("t [s]")
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    return figure


def draw_residual_against(loop: ClosedLoop, joint: str) -> Figure | None:
    """Residual of a joint on all runs against the signals it depends on, with medians of bins."""
    if loop.signals is None:
        return None
    signals = dominant_signals(loop, joint)
    if not signals:
        return None
    with figure_style():
        figure = new_figure(10.0, 3.2)
        axes = np.atleast_1d(figure.subplots(1, len(signals), sharey=True, squeeze=False)).ravel()
        for ax, signal in zip(axes, signals, strict=True):
            rows = against_signal(loop, joint, signal)
            some = rows.iloc[thin(len(rows), 2500)]
            for stage in STAGES:
                y = f"residual_{stage}"
                ax.plot(
                    some["x"],
                    some[y],
                    ".",
                    color=COLOURS[stage],
                    ms=2.6,
                    alpha=min(0.7, 900 / max(len(some), 1)),
                    mew=0,
                )
            for stage in STAGES:
                x, middle = bin_medians(rows["x"].to_numpy(), rows[f"residual_{stage}"].to_numpy())
                ax.plot(x, middle, "-o", color="white", lw=3.2, ms=4.5)
                ax.plot(x, middle, "-o", color=COLOURS[stage], ms=3.0, label=f"{stage}, medians")
            ax.axhline(0.0, color="#999999", lw=0.6, zorder=0)
            ax.set_xlabel(_signal_label(loop, signal))
        axes[0].set_ylabel(f"{joint}: residual [{loop.verdict['joints'][joint]['unit']}]")
        axes[-1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    return figure


def _signal_label(loop: ClosedLoop, signal: str) -> str:
    if signal == "t":
        return "time since the start of the run [s]"
    place = split_signal(signal, loop.joints)
    assert place is not None
    torque = loop.verdict["joints"][place[1]]["unit"]
    word, unit = _SIGNAL_NAMES[place[0]]
    return f"{word} of {place[1]} [{unit.format(position='m' if torque == 'N' else 'rad', torque=torque)}]"


def bin_medians(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Medians of `y` in bins of equal width of `x`, where a bin has five or more."""
    low, high = np.quantile(x, [0.002, 0.998])
    if not high > low:
        return np.array([np.median(x)]), np.array([np.median(y)])
    edges = np.linspace(low, high, _BINS + 1)
    place = np.digitize(x, edges) - 1
    kept = [k for k in range(_BINS) if (place == k).sum() >= 5]
    centre = 0.5 * (edges[1:] + edges[:-1])
    return centre[kept], np.array([np.median(y[place == k]) for k in kept])


def draw_candidates(ranking: pd.DataFrame, title: str) -> Figure:
    """Cross-validated gain of candidates, best first, with what was made of each.

    Parameters
    ----------
    ranking : DataFrame
        `label`, `cv_gain`, `taken`, `reason`.
    """
    with figure_style():
        figure = new_figure(10.0, 0.7 + 0.25 * len(ranking))
        ax = figure.subplots()
        gains = 100 * ranking["cv_gain"].to_numpy(dtype=float)
        colours = [AFTER if taken else "#b8bec6" for taken in ranking["taken"]]
        ax.barh(np.arange(len(ranking)), np.maximum(gains, 0.0), color=colours)
        reach = max(float(np.nanmax(gains, initial=0.0)), 1.0)
        for k, (gain, reason) in enumerate(zip(gains, ranking["reason"], strict=True)):
            text = f"{gain:.1f} %, {reason}".replace("-", "−", 1 if gain < 0 else 0)
            ax.text(max(gain, 0.0) + 0.01 * reach, k, text, va="center", fontsize=7.5)
        ax.set_yticks(np.arange(len(ranking)), ranking["label"])
        ax.set_ylim(len(ranking) - 0.4, -0.6)
        ax.set_xlim(0.0, 1.9 * reach)
        ax.set_xticks([tick for tick in ax.get_xticks() if tick <= reach])
        ax.set_xlabel("held-out loss that it removes [% of the joint's]")
        ax.set_title(title)
    return figure


def draw_isolability(table: pd.DataFrame, joint: str) -> Figure:
    """Angles between the candidates at a joint; on the diagonal, to the declared model."""
    own = table[table["joint"] == joint]
    names = sorted(set(own["effect_a"]) | set(own["effect_b"]))
    values = np.full((len(names), len(names)), np.nan)
    for row in own.itertuples(index=False):
        i, k = names.index(row.effect_a), names.index(row.effect_b)
        values[i, k] = values[k, i] = row.largest_angle_deg
        for place, sine in ((i, row.sine_a), (k, row.sine_b)):
            values[place, place] = np.degrees(np.arcsin(np.clip(sine, 0.0, 1.0)))
    with figure_style():
        side = 2.4 + 0.36 * len(names)
        figure = new_figure(side + 0.8, side)
        ax = figure.subplots()
        mesh = draw_heat(
            ax, values, names, names, Normalize(0.0, 90.0), "viridis", lambda x: f"{x:.0f}", size=6.5
        )
        ax.tick_params(axis="x", rotation=90)
        ax.set_title(f"{joint}: angle [deg]; diagonal: to the declared model")
        figure.colorbar(mesh, ax=ax, label="angle [deg], 0: cannot be told apart", aspect=30, pad=0.01)
    return figure


def draw_forward(loop: ClosedLoop, joints: Sequence[str]) -> Figure | None:
    """Torque of both models simulated forward, less the measured one, along the first test run."""
    series = loop.forward_series
    if series is None or not len(series):
        return None
    run = series["run"].iloc[0]
    with figure_style():
        figure = new_figure(10.0, 1.9 * len(joints) + 0.5)
        axes = np.atleast_1d(figure.subplots(len(joints), 1, sharex=True, squeeze=False)).ravel()
        for ax, joint in zip(axes, joints, strict=True):
            rows = series[(series["run"] == run) & (series["joint"] == joint)]
            rows = rows.iloc[thin(len(rows))]
            errors = {
                f"model {stage}": (rows[f"simulated_{stage}"] - rows["measured"]).to_numpy()
                for stage in STAGES
            }
            _draw_over_time(ax, rows, errors)
            ax.set_ylabel(f"error [{loop.verdict['joints'][joint]['unit']}]")
            ax.set_title(f"{joint}, {run}")
        axes[-1].set_xlabel("t [s]")
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    return figure
