"""Fig. 3: signal-to-noise ratios by group, and their ranks."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from wearscope.reporting.figures.boxes import draw_boxes, use_symlog
from wearscope.reporting.labels import finite, group_name, split_groups
from wearscope.reporting.style import WARNING, colours, figure_style, markers, new_figure

_STEP = 0.618034
"""Points of a box are spread by multiples of the golden ratio: evenly, and the same each time."""


def draw_snr(snr: pd.DataFrame, ranking: pd.DataFrame, by: Sequence[str] = ("fda",)) -> Figure:
    """Box plots of the SNR (11) with every cell, and median and rank with their intervals.

    Parameters
    ----------
    snr : DataFrame
        The keys, ``snr``, ``status``.
    ranking : DataFrame
        From `wearscope.evaluation.ranking.rank_by_median` over the same groups.
    by : sequence of str
    """
    groups = list(split_groups(snr, by))
    names = [name for name, _ in groups]
    tint = colours(names)
    height = max(3.4, 1.0 + 0.32 * len(names))
    with figure_style():
        figure = new_figure(10.0, height if len(names) > 8 else 4.2)
        boxes, medians, ranks = figure.subplots(1, 3, width_ratios=[2.4, 1.2, 0.8])
        _draw_cells(boxes, groups, tint)
        _draw_ranking(medians, ranks, ranking, by, tint)
    return figure


def _draw_cells(ax: Axes, groups: Sequence[tuple[str, pd.DataFrame]], tint: dict[str, str]) -> None:
    robots = sorted({robot for _, rows in groups for robot in rows["robot"]})
    shape = markers(robots)
    labels = []
    for k, (name, rows) in enumerate(groups):
        draw_boxes(ax, [rows["snr"]], [k], tint[name], width=0.5)
        spread = 0.28 + 0.18 * (np.arange(len(rows)) * _STEP % 1.0)
        for robot in robots:
            here = (rows["robot"] == robot).to_numpy() & np.isfinite(rows["snr"].to_numpy(dtype=float))
            falls = here & (rows["status"] == "decreasing").to_numpy()
            y = rows["snr"].to_numpy(dtype=float)
            fine = here & ~falls
            ax.plot(k + spread[fine], y[fine], shape[robot], color=tint[name], ms=3.5, alpha=0.75, mew=0)
            ax.plot(k + spread[falls], y[falls], shape[robot], mfc="none", mec=WARNING, ms=5, mew=1.1)
        missing = len(rows) - finite(rows["snr"]).size
        labels.append(f"{name}\n{len(rows)} cells" + (f"\n{missing} n/a" if missing else ""))
    for robot in robots:
        ax.plot([], [], shape[robot], color="#666666", ms=4, label=f"a cell of {robot}")
    if any((rows["status"] == "decreasing").any() for _, rows in groups):
        ax.plot([], [], "o", mfc="none", mec=WARNING, label="y falls with wear")
    ax.axhline(0, color="#999999", lw=0.7, zorder=0)
    use_symlog(ax, "y", pd.concat([rows["snr"] for _, rows in groups]), 10.0)
    ax.set_xticks(range(len(groups)), labels, rotation=45 if len(groups) > 8 else 0)
    ax.set_ylabel("signal-to-noise ratio")
    ax.set_title("Every cell")
    ax.grid(axis="y")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2 if len(groups) <= 8 else -0.3), ncols=3)


def _draw_ranking(
    medians: Axes, ranks: Axes, ranking: pd.DataFrame, by: Sequence[str], tint: dict[str, str]
) -> None:
    names = [group_name(by, [row[name] for name in by]) for _, row in ranking.iterrows()]
    for k, (name, row) in enumerate(zip(names, ranking.itertuples(), strict=True)):
        colour = tint.get(name, "#666666")
        if np.isfinite(row.median):
            medians.plot([row.median_low, row.median_high], [k, k], color=colour, lw=2.5, alpha=0.6)
            medians.plot([row.median], [k], "o", color=colour)
            medians.annotate(
                f"{row.median:.3g}",
                (row.median, k),
                (0, 6),
                textcoords="offset points",
                ha="center",
                fontsize=8,
            )
        else:
            medians.text(0.5, k, "n/a", transform=medians.get_yaxis_transform(), ha="center", va="center")
        ranks.plot([row.rank_low, row.rank_high], [k, k], color=colour, lw=2.5, alpha=0.6)
        ranks.plot([row.rank], [k], "o", color=colour)
    for ax, title in ((medians, "Median SNR, 95 %"), (ranks, "Rank, 95 %")):
        ax.set_ylim(len(names) - 0.4, -0.6)
        ax.set_yticks(range(len(names)), names)
        ax.set_title(title)
        ax.grid(axis="x")
    medians.set_xlabel("median SNR [-]")
    ranks.set_xlabel("rank, 1 is best")
    ranks.set_xlim(0.5, len(names) + 0.5)
    ranks.xaxis.set_major_locator(MaxNLocator(integer=True))
