"""Fig. 4: group scope matrices of one factor, by both methods."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, Normalize
from matplotlib.figure import FigureBase
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from wearscope.evaluation.scope import count_matrix, count_scope
from wearscope.reporting.labels import count_text, factor_name, split_groups, unit_text
from wearscope.reporting.style import figure_style, new_figure

if TYPE_CHECKING:
    from wearscope.designs.factors import Factor

MOST = 8
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
        At most `MOST` groups are drawn, the title says so where there are more.
    figure : matplotlib figure, optional
        An empty one, or a part of one, to draw in.
    """
    rows = counts[counts["factor"] == factor]
    known = {one.name: one for one in factors}
    groups = list(split_groups(rows, by))
    shown = groups[:MOST]
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
