"""Fig. 2: normalised coefficients by group."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wearscope.reporting.figures.boxes import draw_boxes, use_symlog
from wearscope.reporting.labels import count_text, split_groups, term_label
from wearscope.reporting.style import colours, figure_style, new_figure

MOST = 12


def draw_sensitivity(
    surrogates: pd.DataFrame, model: str = "simplified", by: Sequence[str] = ("fda",)
) -> Figure:
    """Box plots of the normalised coefficients (8) of every group of cells.

    Parameters
    ----------
    surrogates : DataFrame
        ``model``, ``term``, ``theta``, ``theta_normalised`` and the keys.
    model : str
    by : sequence of str
        Keys that form a group; at most `MOST` groups are drawn, the title says so where there are more.
    """
    rows = surrogates[(surrogates["model"] == model) & (surrogates["term"] != "1")]
    terms = list(dict.fromkeys(rows["term"]))
    groups = list(split_groups(rows, by))
    shown = groups[:MOST]
    tint = colours([name for name, _ in groups])
    with figure_style():
        figure = new_figure(10.0, 0.9 + 1.9 * len(shown))
        axes = figure.subplots(len(shown), 1, squeeze=False, sharex=True)[:, 0]
        for ax, (name, group) in zip(axes, shown, strict=True):
            _draw_group(ax, name, group, terms, tint[name])
        _label_parts(axes[0], terms)
        axes[-1].set_xticks(range(len(terms)), [term_label(term) for term in terms])
        if max(map(len, terms)) > 6:
            axes[-1].tick_params(axis="x", rotation=60)
        figure.supylabel("coefficient over that of wear f [-]", fontsize=9)
        left_out = len(groups) - len(shown)
        if left_out:
            figure.suptitle(f"First {len(shown)} of {len(groups)} groups")
    return figure


def _draw_group(ax: Axes, name: str, group: pd.DataFrame, terms: Sequence[str], colour: str) -> None:
    ax.axhspan(-1, 1, color="#f0f0f0", zorder=0, lw=0)
    for level in (-1, 1):
        ax.axhline(level, color="#555555", lw=0.8, ls="--", zorder=1)
    ax.axhline(0, color="#999999", lw=0.6, zorder=1)
    values = [group.loc[group["term"] == term, "theta_normalised"] for term in terms]
    draw_boxes(ax, values, [colour] * len(terms))
    use_symlog(ax, "y", group["theta_normalised"])
    fault = group[group["term"] == "f"]
    parts = [count_text(len(fault), "cell")]
    unknown = int((~np.isfinite(fault["theta_normalised"].to_numpy(dtype=float))).sum())
    falling = int((fault["theta"] < 0).sum())
    if falling:
        parts.append(f"y falls with wear in {falling}")
    if unknown:
        parts.append(f"no direct effect of wear, hence no box, in {unknown}")
    ax.set_title(f"{name}  ({'; '.join(parts)})", fontsize=9)
    ax.set_xlim(-0.6, len(terms) - 0.4)
    if unknown == len(fault):
        ax.text(0.5, 0.5, "n/a", transform=ax.transAxes, ha="center", va="center", color="#666666")


def _label_parts(ax: Axes, terms: Sequence[str]) -> None:
    """Say above the first panel where the interactions and the squares begin."""
    kinds = ["interactions" if ":" in term else "squares" if "^" in term else "direct" for term in terms]
    for kind in dict.fromkeys(kinds):
        first, last = kinds.index(kind), len(kinds) - 1 - kinds[::-1].index(kind)
        middle = 0.5 * (first + last)
        ax.annotate(
            kind, (middle, 1.0), (0, 15), xycoords=("data", "axes fraction"), textcoords="offset points",
            ha="center", fontsize=8, color="#444444",
        )  # fmt: skip
        if first:
            for one in ax.figure.axes:
                one.axvline(first - 0.5, color="#bbbbbb", lw=0.7, zorder=0)
