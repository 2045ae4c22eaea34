"""Figures of tracking: the trend of every joint."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wearscope.reporting.style import AFTER, BEFORE, NEUTRAL, figure_style, new_figure
from wearscope.reporting.tracking import Tracking

#: Most labels of sessions along an axis.
_LABELS = 24


def draw_friction(tracking: Tracking) -> Figure:
    """Friction of every joint over the sessions, as a share of the reference's, with 95 % intervals."""
    joints = tracking.joints
    across = 1 if len(joints) == 1 else 2
    down = -(-len(joints) // across)
    with figure_style():
        figure = new_figure(10.0, 2.3 * down + 0.9)
        axes = np.atleast_1d(figure.subplots(down, across, squeeze=False)).ravel()
        for ax, joint in zip(axes, joints, strict=False):
            rows = tracking.rows(joint, "friction", "torque")
            healthy = float((rows["value"] - rows["change"]).median())
            _draw_trend(ax, tracking, rows, 100.0 / healthy, _sessions_with(tracking, joint))
            ax.set_title(joint)
            ax.set_ylabel("friction [% of healthy]")
        for ax in axes[len(joints) :]:
            ax.axis("off")
        _draw_legend(figure, axes[0])
    return figure


def draw_parameter(tracking: Tracking, joint: str, effect: str, parameter: str) -> Figure:
    """One parameter over the sessions, with 95 % intervals."""
    rows = tracking.rows(joint, effect, parameter)
    unit = rows["unit"].dropna().iloc[0]
    named = {
        session
        for session, entry in tracking.entries()
        if (entry["joint"], entry["effect"]) == (joint, effect)
    }
    with figure_style():
        figure = new_figure(10.0, 3.0)
        ax = figure.subplots()
        _draw_trend(ax, tracking, rows, 1.0, named)
        ax.set_title(f"{joint}: {effect}, {parameter}")
        ax.set_ylabel(f"{parameter} [{unit}]")
        _draw_legend(figure, ax)
    return figure


def _sessions_with(tracking: Tracking, joint: str) -> set[str]:
    return {session for session, entry in tracking.entries() if entry["joint"] == joint}


def _draw_trend(ax: Axes, tracking: Tracking, rows: pd.DataFrame, factor: float, named: set[str]) -> None:
    sessions = list(rows.index)
    healthy = np.array([s in set(tracking.sessions[: _count_healthy(tracking)]) for s in sessions])
    counts = np.array([s in named for s in sessions])
    x = np.arange(len(sessions))
    value = factor * rows["value"].to_numpy(dtype=float)
    low, high = (factor * rows[f"value_{end}"].to_numpy(dtype=float) for end in ("low", "high"))
    for pick, colour, marker in (
        (healthy, NEUTRAL, "s"),
        (~healthy & ~counts, AFTER, "o"),
        (~healthy & counts, BEFORE, "D"),
    ):
        ax.vlines(x[pick], low[pick], high[pick], color=colour, lw=1.4)
        ax.plot(x[pick], value[pick], marker, color=colour, ms=5, mec="white", mew=0.6)
    ax.axvline(healthy.sum() - 0.5, color="#999999", lw=0.8, ls=":")
    if np.isfinite(value[healthy]).any():
        ax.axhline(float(np.nanmean(value[healthy])), color="#999999", lw=0.6, zorder=0)
    _limit(ax, value)
    every = max(1, -(-len(sessions) // _LABELS))
    ax.set_xticks(x[::every], sessions[::every], rotation=60, ha="right", fontsize=7)
    ax.set_xlim(-0.6, len(sessions) - 0.4)


def _limit(ax: Axes, value: np.ndarray) -> None:
    """Show the estimates; an interval that says nothing may leave the frame."""
    known = value[np.isfinite(value)]
    if len(known):
        reach = max(1.5 * float(np.ptp(known)), 0.2 * float(np.abs(known).max()), 1e-9)
        middle = 0.5 * float(known.max() + known.min())
        ax.set_ylim(middle - reach, middle + reach)


def _count_healthy(tracking: Tracking) -> int:
    return len(tracking.sessions) - len(tracking.outcome["sessions"])


def _draw_legend(figure: Figure, ax: Axes) -> None:
    labels: Sequence[tuple[str, str, str]] = (
        ("s", NEUTRAL, "healthy, held out"),
        ("o", AFTER, "no change named"),
        ("D", BEFORE, "change named"),
    )
    handles = [ax.plot([], [], mark, color=colour, label=label)[0] for mark, colour, label in labels]
    figure.legend(handles=handles, loc="outside upper center", ncols=3)
