"""The design matrices: which factor stands where in which run."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from wearscope.reporting.figures.heat import draw_heat
from wearscope.reporting.labels import with_unit
from wearscope.reporting.style import figure_style, new_figure

if TYPE_CHECKING:
    from wearscope.designs.factors import Factor

MOST = 90


def draw_design(designs: Mapping[str, pd.DataFrame], factors: Sequence["Factor"]) -> Figure:
    """Coded levels, identification coding, of every run of every set; factors down, runs across.

    Parameters
    ----------
    designs : mapping of str to DataFrame
        ``point`` and the coded factors by set; of sets with more than `MOST` runs the first are drawn.
    factors : sequence of Factor
    """
    names = [factor.name for factor in factors]
    wear = [factor.name for factor in factors if factor.kind == "wear"]
    labels = [
        with_unit(
            f"{one.name}  {_description(one, wear)}, " + f"{one.low:g} to {one.high:g}".replace("-", "−"),
            one.unit,
        )
        for one in factors
    ]
    widest = max(min(len(design), MOST) for design in designs.values())
    with figure_style():
        figure = new_figure(10.5, 0.4 + sum(0.75 + 0.2 * len(names) for _ in designs))
        axes = figure.subplots(len(designs), 1, squeeze=False)[:, 0]
        mesh = None
        for ax, (name, design) in zip(axes, designs.items(), strict=True):
            part = design.head(MOST)
            values = np.full((len(names), widest), np.nan)
            values[:, : len(part)] = part[names].to_numpy(dtype=float).T
            mesh = draw_heat(
                ax, values[:, : len(part)], labels, _sparse(part["point"]), Normalize(-2, 2), "PuOr"
            )
            ax.set_xlim(0, widest)
            more = f", first {MOST} drawn" if len(design) > MOST else ""
            ax.set_title(f"{name}  ({len(design)} run{'s' if len(design) != 1 else ''}{more})", fontsize=9)
        axes[-1].set_xlabel("point")
        if mesh is not None:
            figure.colorbar(mesh, ax=list(axes), label="coded level", pad=0.01, aspect=30)
    return figure


def _description(factor: "Factor", wear: Sequence[str]) -> str:
    """What a factor is in a simulated run, where the k-th wear factor is the wear of axis k."""
    return f"wear of axis {wear.index(factor.name) + 1}" if factor.name in wear else factor.description


def _sparse(points: pd.Series) -> list[str]:
    """Label of every fifth point and of the first, where there are many."""
    few = len(points) <= 12
    return [
        str(point) if few or k == 0 or point % 5 == 0 else ""
        for k, point in enumerate(points.astype(int).to_list())
    ]
