"""Figures of a study's tables as matplotlib draws them: Figs. 2 to 4.

Figs. 2 and 3 are box plots of normalised coefficients, and of signal-to-noise ratios with their ranks. Fig. 4
has group scope matrices of one factor, by both methods.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, Normalize, to_rgba
from matplotlib.figure import FigureBase
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from wearscope.evaluation.scope import count_matrix, count_scope
from wearscope.reporting.labels import (
    count_text,
    factor_name,
    finite,
    group_name,
    split_groups,
    term_label,
    unit_text,
)
from wearscope.reporting.style import MARKERS, WARNING, colours, figure_style, new_figure

if TYPE_CHECKING:
    from wearscope.designs.factors import Factor

#: Largest number of groups in a figure of the coefficients.
MOST = 12


def draw_sensitivity(
    surrogates: pd.DataFrame,
    model: str = "simplified",
    by: Sequence[str] = ("fda",),
    figure: FigureBase | None = None,
) -> FigureBase:
    """Box plots of the normalised coefficients (8) of every group of cells.

    Parameters
    ----------
    surrogates : DataFrame
        ``model``, ``term``, ``theta``, ``theta_normalised`` and the keys.
    model : str
    by : sequence of str
        Keys that form a group; at most `MOST` groups are drawn, the title says so where there are more.
    figure : matplotlib figure, optional
        An empty one, or a part of one, to draw in.
    """
    rows = surrogates[(surrogates["model"] == model) & (surrogates["term"] != "1")]
    terms = list(dict.fromkeys(rows["term"]))
    groups = list(split_groups(rows, by))
    shown = groups[:MOST]
    tints = colours([name for name, _ in groups])
    with figure_style():
        figure = figure or new_figure(10.0, 0.9 + 1.9 * len(shown))
        axes = figure.subplots(len(shown), 1, squeeze=False, sharex=True)[:, 0]
        for ax, (name, group) in zip(axes, shown, strict=True):
            _draw_terms(ax, name, group, terms, tints[name])
        _label_parts(list(axes), terms)
        axes[-1].set_xticks(range(len(terms)), [term_label(term) for term in terms])
        if max(map(len, terms)) > 6:
            axes[-1].tick_params(axis="x", rotation=60)
        figure.supylabel("coefficient over that of wear f [-]", fontsize=9)
        if len(groups) > len(shown):
            figure.suptitle(f"First {len(shown)} of {len(groups)} groups")
    return figure


def _draw_terms(ax: Axes, name: str, group: pd.DataFrame, terms: Sequence[str], colour: str) -> None:
    ax.axhspan(-1, 1, color="#f0f0f0", zorder=0, lw=0)
    for level, look in ((-1, "--"), (0, "-"), (1, "--")):
        ax.axhline(level, color="#777777", lw=0.7, ls=look, zorder=1)
    values = [group.loc[group["term"] == term, "theta_normalised"] for term in terms]
    _draw_boxes(ax, values, [colour] * len(terms))
    use_symlog(ax, group["theta_normalised"])
    fault = group[group["term"] == "f"]
    parts = [count_text(len(fault), "cell")]
    unknown = int((~np.isfinite(fault["theta_normalised"].to_numpy(dtype=float))).sum())
    if falling := int((fault["theta"] < 0).sum()):
        parts.append(f"y falls with wear in {falling}")
    if unknown:
        parts.append(f"no direct effect of wear, hence no box, in {unknown}")
    ax.set_title(f"{name}  ({'; '.join(parts)})", fontsize=9)
    ax.set_xlim(-0.6, len(terms) - 0.4)
    if unknown == len(fault):
        ax.text(0.5, 0.5, "n/a", transform=ax.transAxes, ha="center", va="center", color="#666666")


def _label_parts(axes: Sequence[Axes], terms: Sequence[str]) -> None:
    """Say above the first panel where the interactions and the squares begin."""
    kinds = ["interactions" if ":" in term else "squares" if "^" in term else "direct" for term in terms]
    for kind in dict.fromkeys(kinds):
        places = [k for k, one in enumerate(kinds) if one == kind]
        look: dict[str, Any] = {"ha": "center", "fontsize": 8, "color": "#444444"}
        middle = (0.5 * (places[0] + places[-1]), 1.0)
        frame = ("data", "axes fraction")
        axes[0].annotate(kind, middle, (0, 15), xycoords=frame, textcoords="offset points", **look)
        for ax in axes if places[0] else ():
            ax.axvline(places[0] - 0.5, color="#bbbbbb", lw=0.7, zorder=0)


def draw_snr(
    snr: pd.DataFrame,
    ranking: pd.DataFrame,
    by: Sequence[str] = ("fda",),
    figure: FigureBase | None = None,
) -> FigureBase:
    """Box plots of the SNR (11) with every cell, and median and rank with their intervals.

    Parameters
    ----------
    snr : DataFrame
        The keys, ``snr``, ``status``.
    ranking : DataFrame
        From `wearscope.evaluation.ranking.rank_by_median` over the same groups.
    by, figure
        As in `draw_sensitivity`.
    """
    groups = dict(split_groups(snr, by))
    tints = colours(list(groups))
    with figure_style():
        figure = figure or new_figure(10.0, 1.0 + 0.32 * len(groups) if len(groups) > 8 else 4.2)
        boxes, medians, ranks = figure.subplots(1, 3, width_ratios=[2.4, 1.2, 0.8])
        _draw_cells(boxes, groups, tints)
        names = [group_name(by, [row[name] for name in by]) for _, row in ranking.iterrows()]
        for ax, what in ((medians, "median"), (ranks, "rank")):
            _draw_intervals(ax, names, ranking, what, tints)
        for place, value in enumerate(ranking["median"].astype(float)):
            if np.isfinite(value):
                medians.text(value, place - 0.12, f"{value:.3g}", ha="center", va="bottom", fontsize=8)
            else:
                frame = medians.get_yaxis_transform()
                medians.text(0.5, place, "n/a", transform=frame, ha="center", va="center")
        medians.set(title="Median SNR, 95 %", xlabel="median SNR [-]")
        ranks.set(title="Rank, 95 %", xlabel="rank, 1 is best", xlim=(0.5, len(names) + 0.5))
        ranks.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure


def _draw_cells(ax: Axes, groups: Mapping[str, pd.DataFrame], tints: Mapping[str, str]) -> None:
    table = pd.concat([rows.assign(place=k + 0.28) for k, rows in enumerate(groups.values())])
    _draw_boxes(ax, [rows["snr"] for rows in groups.values()], list(tints.values()), width=0.5)
    known = table[np.isfinite(table["snr"].to_numpy(dtype=float))]
    robots = known.groupby("robot", sort=True)
    for k, (robot, rows) in enumerate(robots):
        place = rows["place"] + 0.18 * k / robots.ngroups
        look: dict[str, Any] = {"color": "#444444", "ms": 3.5, "mew": 0, "label": f"a cell of {robot}"}
        ax.plot(place, rows["snr"], MARKERS[k % len(MARKERS)], **look)
    falling = known[known["status"] == "decreasing"]
    if len(falling):
        look = {"mfc": "none", "mec": WARNING, "ms": 6, "mew": 1.1, "label": "y falls with wear"}
        ax.plot(falling["place"], falling["snr"], "o", **look)
    ax.axhline(0, color="#999999", lw=0.7, zorder=0)
    use_symlog(ax, table["snr"], 10.0)
    missing = {name: len(rows) - finite(rows["snr"]).size for name, rows in groups.items()}
    labels = [
        f"{name}\n{len(rows)} cells" + (f"\n{missing[name]} n/a" if missing[name] else "")
        for name, rows in groups.items()
    ]
    ax.set_xticks(range(len(groups)), labels, rotation=45 if len(groups) > 8 else 0)
    ax.set(ylabel="signal-to-noise ratio", title="Every cell")
    ax.grid(axis="y")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2 if len(groups) <= 8 else -0.3), ncols=3)


def _draw_intervals(
    ax: Axes, names: Sequence[str], ranking: pd.DataFrame, what: str, tints: Mapping[str, str]
) -> None:
    """Median or rank of each group in a row of its own, in the ranking's order."""
    for place, name in enumerate(names):
        value, low, high = ranking.iloc[place][[what, f"{what}_low", f"{what}_high"]].astype(float)
        look: dict[str, Any] = {"fmt": "o", "color": tints.get(name, "#666666"), "lw": 2.5}
        if np.isfinite(value):
            ax.errorbar([value], [place], xerr=[[value - low], [high - value]], **look)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.set_yticks(range(len(names)), names)
    ax.grid(axis="x")


def _draw_boxes(ax: Axes, values: Sequence[object], tints: Sequence[str], width: float = 0.6) -> None:
    """Boxes from quartile to quartile, whiskers of 1.5 boxes, outliers; of the finite values."""
    look: dict[str, Any] = {"widths": width, "patch_artist": True, "manage_ticks": False}
    for k, (one, colour) in enumerate(zip(values, tints, strict=True)):
        line = {"color": colour, "linewidth": 0.9}
        box = {"facecolor": to_rgba(colour, 0.35), "edgecolor": colour, "linewidth": 0.9}
        ax.boxplot(
            [finite(one)], positions=[k], boxprops=box, whiskerprops=line, capprops=line,
            medianprops={"color": "black", "linewidth": 1.6},
            flierprops={"markersize": 2.5, "markeredgecolor": colour}, **look,
        )  # fmt: skip


def use_symlog(ax: Axes, values: object, threshold: float = 1.0) -> bool:
    """Scale the vertical axis linearly within ±`threshold` and logarithmically beyond, if values reach far.

    Returns
    -------
    bool
        Whether it was needed: some value lies beyond 20 thresholds.
    """
    good = np.abs(finite(values))
    if not good.size or good.max() <= 20 * threshold:
        return False
    ax.set_yscale("symlog", linthresh=threshold, linscale=1.0)
    ax.yaxis.set_major_formatter("{x:g}")
    ax.margins(y=0.06)
    return True


MOST_SCOPES = 8
METHOD_NAMES = {"exact": "closed form", "kde": "Monte Carlo, KDE"}


def draw_scope(
    scope: pd.DataFrame,
    factor: str,
    factors: Sequence["Factor"],
    by: Sequence[str] = ("fda",),
    figure: FigureBase | None = None,
) -> FigureBase:
    """Group scope matrices (Fig. 4) of a table from `wearscope.evaluation.scope`; see `draw_scope_counts`."""
    return draw_scope_counts(count_scope(scope[scope["factor"] == factor], by), factor, factors, by, figure)


def draw_scope_counts(
    counts: pd.DataFrame,
    factor: str,
    factors: Sequence["Factor"],
    by: Sequence[str] = ("fda",),
    figure: FigureBase | None = None,
) -> FigureBase:
    """Group scope matrices (Fig. 4): a column for each group, a row for each method.

    The solid line bounds where half the cells of a group pass; the dashed one, where half of them pass with
    95 % confidence in the surrogate's coefficients.

    Parameters
    ----------
    counts : DataFrame
        From `wearscope.evaluation.scope.count_scope`, by the same groups.
    factor : str
        The nuisance that varies.
    factors : sequence of Factor
        To say what coded levels mean.
    by : sequence of str
        At most `MOST_SCOPES` groups are drawn, the title says so where there are more.
    figure : matplotlib figure, optional
        An empty one, or a part of one, to draw in.
    """
    rows = counts[counts["factor"] == factor]
    known = {one.name: one for one in factors}
    groups = list(split_groups(rows, by))
    shown = groups[:MOST_SCOPES]
    methods = [method for method in METHOD_NAMES if (rows["method"] == method).any()]
    with figure_style():
        if not groups:
            figure = figure or new_figure(5.0, 1.2)
            figure.text(0.5, 0.5, f"{factor} moves no torque and was dropped on every robot", ha="center")
            return figure
        figure = figure or new_figure(1.6 + 2.3 * len(shown), 1.1 + 2.15 * len(methods))
        axes = figure.subplots(len(methods), len(shown), squeeze=False, sharex=True, sharey=True)
        cells = int(rows["cells"].max())
        norm = BoundaryNorm(np.arange(-0.5, cells + 1), 256) if cells < 12 else Normalize(0, cells)
        for column, (name, group) in zip(axes.T, shown, strict=True):
            for ax, method in zip(column, methods, strict=True):
                _draw_method(ax, group[group["method"] == method], norm)
            many = count_text(int(group["cells"].max()), "cell")
            column[0].set_title(f"{name}  ({many})", fontsize=9, pad=28)
            first = group[group["method"] == methods[0]]
            sigma, delta, _ = count_matrix(first, first["passes"])
            _add_natural(column[0], "x", sigma, known.get(factor))
        _add_natural(axes[0, -1], "y", delta, known.get("f"))
        figure.colorbar(
            ScalarMappable(norm, colormaps["cividis"]), ax=axes.ravel().tolist(),
            label="cells that pass", aspect=30, pad=0.02,
            ticks=MaxNLocator(integer=True),
        )  # fmt: skip
        for ax, method in zip(axes[:, 0], methods, strict=True):
            ax.set_ylabel(f"{METHOD_NAMES[method]}\nchange Δ of wear [coded]")
        for ax in axes[-1]:
            ax.set_xlabel(f"σ of {factor_name(known[factor]) if factor in known else factor} [coded]")
        if len(groups) > len(shown):
            figure.suptitle(f"First {len(shown)} of {len(groups)} groups")
    return figure


def _draw_method(ax: Axes, rows: pd.DataFrame, norm: Normalize) -> None:
    """Counts on the grid, and where half the cells pass: by the estimates, and with confidence."""
    sigma, delta, count = count_matrix(rows, rows["passes"])
    look: dict[str, Any] = {"cbar": False, "xticklabels": False, "yticklabels": False, "rasterized": True}
    sns.heatmap(count, ax=ax, cmap="cividis", norm=norm, **look)
    ax.invert_yaxis()
    for axis, grid in ((ax.xaxis, sigma), (ax.yaxis, delta)):
        ticks = MaxNLocator(4).tick_values(grid[0], grid[-1])
        ticks = ticks[(ticks >= grid[0] - 1e-9) & (ticks <= grid[-1] + 1e-9)]
        axis.set_ticks(_place(grid, ticks), [f"{tick:g}" for tick in ticks])
    ax.tick_params(axis="y", rotation=0)
    level = int(rows["cells"].max()) / 2 - 1e-9
    for passing, style in (("passes", "solid"), ("sure", "dashed")):
        known = passing == "passes" or rows["known"].any()
        values = count_matrix(rows, rows[passing])[2]
        if known and values.min() < level < values.max():
            for colour, width in (("white", 2.6), ("black", 1.2)):
                look = {"colors": colour, "linewidths": width, "linestyles": style}
                ax.contour(_place(sigma, sigma), _place(delta, delta), values, levels=[level], **look)


def _place(grid: NDArray[np.float64], values: ArrayLike) -> NDArray[np.float64]:
    """Where values of an evenly spaced grid lie on its heat map."""
    return (np.asarray(values, dtype=float) - grid[0]) / (grid[1] - grid[0]) + 0.5


def _add_natural(ax: Axes, axis: str, grid: NDArray[np.float64], factor: "Factor | None") -> None:
    """Scale in natural units: at the top for sigma, at the right for wear."""
    if factor is None:
        return
    step, width = factor.step, grid[1] - grid[0]
    scales = (
        lambda place: step * (grid[0] + np.subtract(place, 0.5) * width),
        lambda natural: _place(grid, np.divide(natural, step)),
    )
    side = "top" if axis == "x" else "right"
    own: Any = getattr(ax, f"secondary_{axis}axis")(side, functions=scales)
    unit = f"[{unit_text(factor.unit) or '-'}]"
    own.set(**{f"{axis}label": unit if axis == "x" else f"change of wear {unit}"})
    getattr(own, f"{axis}axis").label.set_fontsize(8)
    own.tick_params(labelsize=7)
    own.spines[side].set_visible(True)
