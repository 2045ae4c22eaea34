"""Fig. 3: signal-to-noise ratios by group, and their ranks."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from wearscope.reporting.figures.boxes import draw_boxes, use_symlog
from wearscope.reporting.labels import finite, group_name, split_groups
from wearscope.reporting.style import MARKERS, WARNING, colours, figure_style, new_figure


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
    table = pd.concat([rows.assign(group=name) for name, rows in groups])
    names = list(tint)
    draw_boxes(ax, [rows["snr"] for _, rows in groups], list(tint.values()), width=0.5)
    known = table[np.isfinite(table["snr"].to_numpy(dtype=float))]
    robots = {f"a cell of {robot}": rows for robot, rows in known.groupby("robot", sort=True)}
    falling = known[known["status"] == "decreasing"]
    for k, (label, rows) in enumerate(robots.items()):
        place = rows["group"].map(names.index) + 0.28 + 0.18 * k / len(robots)
        ax.plot(place, rows["snr"], MARKERS[k % len(MARKERS)], color="#444444", ms=3.5, mew=0, label=label)
    if len(falling):
        place = falling["group"].map(names.index) + 0.28
        look: dict[str, Any] = {
            "mfc": "none",
            "mec": WARNING,
            "ms": 6,
            "mew": 1.1,
            "label": "y falls with wear",
        }
        ax.plot(place, falling["snr"], "o", **look)
    ax.axhline(0, color="#999999", lw=0.7, zorder=0)
    use_symlog(ax, "y", table["snr"], 10.0)
    missing = {name: len(rows) - finite(rows["snr"]).size for name, rows in groups}
    labels = [
        f"{name}\n{len(rows)} cells" + (f"\n{missing[name]} n/a" if missing[name] else "")
        for name, rows in groups
    ]
    ax.set_xticks(range(len(groups)), labels, rotation=45 if len(groups) > 8 else 0)
    ax.set_ylabel("signal-to-noise ratio")
    ax.set_title("Every cell")
    ax.grid(axis="y")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2 if len(groups) <= 8 else -0.3), ncols=3)


def _draw_ranking(
    medians: Axes, ranks: Axes, ranking: pd.DataFrame, by: Sequence[str], tint: dict[str, str]
) -> None:
    names = [group_name(by, [row[name] for name in by]) for _, row in ranking.iterrows()]
    for k, name in enumerate(names):
        row, colour = ranking.iloc[k], tint.get(name, "#666666")
        for ax, what in ((medians, "median"), (ranks, "rank")):
            value, low, high = row[[what, f"{what}_low", f"{what}_high"]].astype(float)
            if np.isfinite(value):
                ax.errorbar([value], [k], xerr=[[value - low], [high - value]], fmt="o", color=colour, lw=2.5)
        if np.isfinite(row["median"]):
            place = (row["median"], k - 0.12)
            medians.text(*place, f"{row['median']:.3g}", ha="center", va="bottom", fontsize=8)
        else:
            medians.text(0.5, k, "n/a", transform=medians.get_yaxis_transform(), ha="center", va="center")
    for ax, title in ((medians, "Median SNR, 95 %"), (ranks, "Rank, 95 %")):
        ax.set_ylim(len(names) - 0.4, -0.6)
        ax.set_yticks(range(len(names)), names)
        ax.set_title(title)
        ax.grid(axis="x")
    medians.set_xlabel("median SNR [-]")
    ranks.set_xlabel("rank, 1 is best")
    ranks.set_xlim(0.5, len(names) + 0.5)
    ranks.xaxis.set_major_locator(MaxNLocator(integer=True))
