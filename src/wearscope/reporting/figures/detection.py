"""Simulated and measured test quantities on one axis."""

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wearscope.reporting.labels import with_unit
from wearscope.reporting.style import AFTER, BEFORE, NEUTRAL, WARNING, figure_style, new_figure

SERIES = {
    "simulated": "simulated, no wear",
    "simulated_worn": "simulated, worn",
    "nominal": "recorded, nominal",
    "judged": "recorded, judged",
}
_TINTS = {"simulated": NEUTRAL, "simulated_worn": "#56B4E9", "nominal": AFTER, "judged": BEFORE}
#: Values further apart than this many times the smallest size stand on a logarithmic axis.
_WIDE = 200.0


def draw_detection(rows: pd.DataFrame, thresholds: pd.DataFrame) -> Figure:
    """Test quantities of one motion: a panel for each joint and detector, each on its own axis.

    Parameters
    ----------
    rows : DataFrame
        `joint`, `fda`, `kind` (a key of `SERIES`), `y`.
    thresholds : DataFrame
        `joint`, `fda`, `unit`, `threshold`.
    """
    known = rows.loc[np.isfinite(rows["y"].astype(float)), "fda"]
    joints = list(dict.fromkeys(thresholds["joint"]))
    fdas = [fda for fda in dict.fromkeys(thresholds["fda"]) if (known == fda).any()] or ["none"]
    with figure_style():
        figure = new_figure(max(4.5, 2.9 * len(fdas) + 1.2), 1.75 * len(joints) + 0.5)
        axes = figure.subplots(len(joints), len(fdas), squeeze=False)
        for i, joint in enumerate(joints):
            for k, fda in enumerate(fdas):
                own = rows[(rows["joint"] == joint) & (rows["fda"] == fda)]
                cell = thresholds[(thresholds["joint"] == joint) & (thresholds["fda"] == fda)]
                _draw_cell(axes[i, k], own, cell, f"{joint}, {fda}", k == 0)
    return figure


def _draw_cell(ax: Axes, rows: pd.DataFrame, cell: pd.DataFrame, title: str, first: bool) -> None:
    ax.set_title(title, fontsize=8)
    ax.tick_params(labelsize=7)
    ax.set_yticks(range(len(SERIES)), list(SERIES.values()) if first else [""] * len(SERIES))
    ax.set_ylim(len(SERIES) - 0.5, -0.5)
    y = rows["y"].to_numpy(dtype=float)
    if not np.isfinite(y).any():
        ax.set_xticks([])
        ax.text(0.5, 0.5, "no test quantity", transform=ax.transAxes, ha="center", va="center", fontsize=8)
        return
    for place, kind in enumerate(SERIES):
        own = rows.loc[rows["kind"] == kind, "y"].dropna()
        if not len(own):
            continue
        if kind.startswith("simulated"):
            sns.boxenplot(
                x=own, y=np.full(len(own), place), ax=ax, orient="h", native_scale=True, width=0.6,
                color=_TINTS[kind], linewidth=0.6, k_depth="trustworthy", flier_kws={"s": 4},
            )  # fmt: skip
        else:
            sns.stripplot(
                x=own, y=np.full(len(own), place), ax=ax, orient="h", native_scale=True, jitter=False,
                size=4.5, color=_TINTS[kind], alpha=0.75,
            )  # fmt: skip
    threshold = float(cell["threshold"].iloc[0])
    if np.isfinite(threshold):
        ax.axvline(threshold, color=WARNING, lw=1.2, ls="--")
    _scale(ax, np.append(y[np.isfinite(y)], threshold if np.isfinite(threshold) else []))
    ax.set_yticks(range(len(SERIES)), list(SERIES.values()) if first else [""] * len(SERIES))
    ax.set_ylim(len(SERIES) - 0.5, -0.5)
    ax.set_ylabel("")
    ax.set_xlabel(with_unit("y", str(cell["unit"].iloc[0])), fontsize=8)


def _scale(ax: Axes, y: np.ndarray) -> None:
    """Logarithmic where the values are far apart, straight about zero where some are negative."""
    size = np.abs(y[y != 0])
    ax.locator_params(axis="x", nbins=3)
    if not len(size) or np.ptp(y) <= _WIDE * np.median(size):
        return
    if (y > 0).all():
        ax.set_xscale("log")
    else:
        ax.set_xscale("symlog", linthresh=float(np.median(size)))
    ax.xaxis.set_major_formatter("{x:g}")
