"""What a drive records: two runs that differ in wear."""

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wearscope.reporting.style import AFTER, BEFORE, NEUTRAL, figure_style, new_figure

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wearscope.designs.factors import Factor
    from wearscope.simulation.recording import Recording


def choose_pair(design: pd.DataFrame, factors: "Sequence[Factor]") -> tuple[int, int]:
    """Two points of a design of which the second has more wear and that differ in little else.

    Among all pairs, that with the largest change of the fault f; among equals, the smallest change of the
    other factors, then the first.

    Returns
    -------
    point with less, point with more wear
    """
    z = design[[factor.name for factor in factors]].to_numpy(dtype=float)
    fault = [factor.role for factor in factors].index("fault")
    change = z[None, :, fault] - z[:, None, fault]
    others = np.abs(np.delete(z[None] - z[:, None], fault, axis=2)).sum(axis=2)
    worth = np.where(change > 0, change - 10.0 * others, -np.inf)
    low, high = np.unravel_index(int(np.argmax(worth)), worth.shape)
    points = design["point"].to_numpy()
    return int(points[low]), int(points[high])


def draw_recording(
    less: "Recording",
    more: "Recording",
    joint: int,
    name: str,
    labels: tuple[str, str],
    units: tuple[str, str] = ("rad", "N m"),
) -> Figure:
    """Position, speed and motor torque of one joint in two runs, and the difference of the torques.

    Parameters
    ----------
    less, more : Recording
        The run with less and the run with more wear.
    joint : int
        Column of the recordings.
    name : str
        What is shown: robot, test-cycle, axis.
    labels : tuple of str
        What the two runs are.
    units : tuple of str
        Of position and torque.
    """
    position, torque = units
    n = min(len(less.t), len(more.t))
    with figure_style():
        figure = new_figure(10.0, 6.4)
        axes = figure.subplots(4, 1, sharex=True, height_ratios=[1, 1, 1.6, 1])
        for run, label, colour in zip((less, more), labels, (AFTER, BEFORE), strict=True):
            for ax, signal in zip(axes, (run.q, run.qd, run.tau), strict=False):
                _draw_curve(ax, run.t, signal[:, joint], colour, label)
        _draw_curve(axes[3], less.t[:n], more.tau[:n, joint] - less.tau[:n, joint], NEUTRAL)
        names = (f"position [{position}]", f"speed [{position}/s]", f"motor torque [{torque}]")
        for ax, text in zip(axes, (*names, f"difference [{torque}]"), strict=True):
            ax.set_ylabel(text)
            ax.grid(axis="y")
        figure.align_ylabels(axes)
        axes[0].set_title(name)
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
        axes[3].set_xlabel("time [s]")
        axes[3].set_xlim(less.t[0], max(less.t[-1], more.t[-1]))
    return figure


def _draw_curve(ax: Axes, t: np.ndarray, y: np.ndarray, colour: str, label: str | None = None) -> None:
    ax.plot(t, y, color=colour, lw=0.9, label=label)
