"""The table like Table 4, for every robot and test-cycle, as a heat map."""

import numpy as np
import pandas as pd
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from wearscope.reporting.figures.heat import draw_heat
from wearscope.reporting.labels import MODEL_NAMES
from wearscope.reporting.style import figure_style, new_figure


def _rounded(value: float) -> str:
    return f"{value:.0f}".replace("-", "−")


def draw_fit(fits: pd.DataFrame) -> Figure:
    """Fit (6) [%] on the validation runs: detectors and models down, test-cycles and axes across.

    Parameters
    ----------
    fits : DataFrame
        From `wearscope.surrogates.validation.fit_table`.
    """
    axes_columns = [name for name in fits.columns if name.startswith("axis_")]
    robots = sorted(fits["robot"].unique())
    cycles = list(dict.fromkeys(fits["cycle"]))
    models = [model for model in MODEL_NAMES if (fits["model"] == model).any()]
    rows = [(fda, model) for fda in sorted(fits["fda"].unique()) for model in models]
    wide = fits.set_index(["robot", "fda", "model", "cycle"])[axes_columns]
    norm = Normalize(0, 100)
    with figure_style():
        width = max(5.0, 2.4 + 0.42 * len(cycles) * len(axes_columns))
        figure = new_figure(width, max(2.8, (0.8 + 0.2 * len(rows)) * len(robots) + 0.3))
        panels = figure.subplots(len(robots), 1, squeeze=False)[:, 0]
        mesh = None
        for ax, robot in zip(panels, robots, strict=True):
            keys = pd.MultiIndex.from_tuples([(robot, *row, cycle) for row in rows for cycle in cycles])
            values = wide.reindex(keys).to_numpy(dtype=float).reshape(len(rows), -1)
            labels = [f"{fda}  {MODEL_NAMES[model]}" for fda, model in rows]
            ticks = [name.removeprefix("axis_") for _ in cycles for name in axes_columns]
            mesh = draw_heat(ax, values, labels, ticks, norm, text=_rounded, size=7)
            ax.set_xlabel("axis", fontsize=8)
            ax.set_title(robot, pad=18)
            for k, cycle in enumerate(cycles):
                middle = (k + 0.5) * len(axes_columns)
                ax.text(middle, -0.2, cycle.replace("_", " "), ha="center", va="bottom", fontsize=8)
                if k:
                    ax.axvline(k * len(axes_columns), color="black", lw=1.2)
            for k in range(len(models), len(rows), len(models)):
                ax.axhline(k, color="black", lw=1.2)
        if mesh is not None:
            lowest = float(np.nanmin(wide.to_numpy(dtype=float), initial=0.0))
            figure.colorbar(
                mesh, ax=list(panels), label="fit [%]", aspect=40, pad=0.01,
                extend="min" if lowest < 0 else "neither",
            )  # fmt: skip
    return figure
