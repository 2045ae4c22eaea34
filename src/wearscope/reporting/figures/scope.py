"""Fig. 4: group scope matrices of one factor, by both methods."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from wearscope.evaluation.scope_counts import count_matrix, count_scope
from wearscope.reporting.labels import count_text, factor_name, split_groups, unit_text
from wearscope.reporting.style import figure_style, new_figure

if TYPE_CHECKING:
    from wearscope.designs.factors import Factor

MOST = 8
METHOD_NAMES = {"exact": "closed form", "kde": "Monte Carlo, KDE"}
Matrix = NDArray[np.float64]


def draw_scope(
    scope: pd.DataFrame, factor: str, factors: Sequence["Factor"], by: Sequence[str] = ("fda",)
) -> Figure:
    """Group scope matrices (Fig. 4) of a table from `wearscope.evaluation.scope`; see `draw_scope_counts`."""
    return draw_scope_counts(count_scope(scope[scope["factor"] == factor], by), factor, factors, by)


def draw_scope_counts(
    counts: pd.DataFrame, factor: str, factors: Sequence["Factor"], by: Sequence[str] = ("fda",)
) -> Figure:
    """Group scope matrices (Fig. 4): a column for each group, a row for each method.

    The solid line bounds where half the cells of a group pass; the dashed one, where half of them pass with
    95 % confidence in the surrogate's coefficients.

    Parameters
    ----------
    counts : DataFrame
        From `wearscope.evaluation.scope_counts.count_scope`, by the same groups.
    factor : str
        The nuisance that varies.
    factors : sequence of Factor
        To say what coded levels mean.
    by : sequence of str
        At most `MOST` groups are drawn, the title says so where there are more.
    """
    rows = counts[counts["factor"] == factor]
    known = {one.name: one for one in factors}
    groups = list(split_groups(rows, by))
    shown = groups[:MOST]
    methods = [method for method in METHOD_NAMES if (rows["method"] == method).any()]
    with figure_style():
        if not groups:
            figure = new_figure(5.0, 1.2)
            figure.text(0.5, 0.5, f"{factor} moves no torque and was dropped on every robot", ha="center")
            return figure
        figure = new_figure(1.6 + 2.3 * len(shown), 1.1 + 2.15 * len(methods))
        axes = figure.subplots(len(methods), len(shown), squeeze=False, sharex=True, sharey=True)
        cells = max(_cells(group) for _, group in shown)
        norm = BoundaryNorm(np.arange(-0.5, cells + 1), 256) if cells < 12 else Normalize(0, cells)
        for column, (name, group) in enumerate(shown):
            for ax, method in zip(axes[:, column], methods, strict=False):
                _draw_method(ax, group[group["method"] == method], norm)
            axes[0, column].set_title(f"{name}  ({count_text(_cells(group), 'cell')})", fontsize=9, pad=28)
            first = group[group["method"] == methods[0]]
            last = column == len(shown) - 1
            _add_natural(axes[0, column], first, known.get(factor), known.get("f"), last)
        figure.colorbar(
            ScalarMappable(norm, colormaps["cividis"]), ax=axes.ravel().tolist(),
            label="cells that pass", aspect=30, pad=0.02,
            ticks=MaxNLocator(integer=True),
        )  # fmt: skip
        names = [METHOD_NAMES[method] for method in methods]
        for ax, name in zip(axes[:, 0], names, strict=True):
            ax.set_ylabel(f"{name}\nchange Δ of wear [coded]")
        for ax in axes[-1]:
            ax.set_xlabel(f"σ of {factor_name(known[factor]) if factor in known else factor} [coded]")
        if len(groups) > len(shown):
            figure.suptitle(f"First {len(shown)} of {len(groups)} groups")
    return figure


def _cells(rows: pd.DataFrame) -> int:
    return int(rows["cells"].max())


def _draw_grid(ax: Axes, sigma: Matrix, delta: Matrix, values: Matrix, **options: Any) -> None:
    """Heat map whose first cell lies at the origin, with ticks in coded units."""
    look: dict[str, Any] = {"cbar": False, "xticklabels": False, "yticklabels": False, "rasterized": True}
    sns.heatmap(values, ax=ax, **look, **options)
    ax.invert_yaxis()
    for axis, grid in ((ax.xaxis, sigma), (ax.yaxis, delta)):
        ticks = MaxNLocator(4).tick_values(grid[0], grid[-1])
        ticks = ticks[(ticks >= grid[0] - 1e-9) & (ticks <= grid[-1] + 1e-9)]
        axis.set_ticks(_place(grid, ticks), [f"{tick:g}" for tick in ticks])
    ax.tick_params(axis="y", rotation=0)


def _place(grid: Matrix, values: ArrayLike) -> Matrix:
    """Where values of an evenly spaced grid lie on its heat map."""
    return (np.asarray(values, dtype=float) - grid[0]) / (grid[1] - grid[0]) + 0.5


def _draw_method(ax: Axes, rows: pd.DataFrame, norm: Normalize) -> None:
    sigma, delta, count = count_matrix(rows, rows["passes"])
    _draw_grid(ax, sigma, delta, count, cmap="cividis", norm=norm)
    half = _cells(rows) / 2
    _draw_edge(ax, count, half, "solid")
    if rows["known"].any():
        _draw_edge(ax, count_matrix(rows, rows["sure"])[2], half, "dashed")


def _draw_edge(ax: Axes, count: Matrix, half: float, style: str) -> None:
    level = half - 1e-9
    if count.min() < level < count.max():
        x, y = (np.arange(n) + 0.5 for n in (count.shape[1], count.shape[0]))
        ax.contour(x, y, count, levels=[level], colors="white", linewidths=2.6, linestyles=style)
        ax.contour(x, y, count, levels=[level], colors="black", linewidths=1.2, linestyles=style)


def _add_natural(
    ax: Axes, rows: pd.DataFrame, factor: "Factor | None", fault: "Factor | None", last: bool
) -> None:
    """Scales in natural units: at the top for sigma, at the right of the last column for wear."""
    sigma, delta, _ = count_matrix(rows, rows["passes"])
    if factor is not None:
        top = ax.secondary_xaxis("top", functions=_scaling(sigma, factor.step))
        top.set_xlabel(f"[{unit_text(factor.unit) or '-'}]", fontsize=8, labelpad=1)
        top.tick_params(labelsize=7)
        top.spines["top"].set_visible(True)
    if fault is not None and last:
        right = ax.secondary_yaxis("right", functions=_scaling(delta, fault.step))
        right.set_ylabel(f"change of wear [{unit_text(fault.unit) or '-'}]", fontsize=8)
        right.tick_params(labelsize=7)
        right.spines["right"].set_visible(True)


def _scaling(
    grid: Matrix, step: float
) -> tuple[Callable[[ArrayLike], ArrayLike], Callable[[ArrayLike], ArrayLike]]:
    """From the place on a heat map to natural units, and back."""
    width = grid[1] - grid[0]
    return (
        lambda place: step * (grid[0] + (np.asarray(place, dtype=float) - 0.5) * width),
        lambda natural: (np.asarray(natural, dtype=float) / step - grid[0]) / width + 0.5,
    )
