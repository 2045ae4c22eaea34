"""SNR of every detector before and after a correction, and as it truly is, with intervals."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from wearscope.reporting.labels import words
from wearscope.reporting.style import AFTER, BEFORE, figure_style, new_figure

_SIDES = (("before", BEFORE, "o", -0.22), ("after", AFTER, "s", 0.0), ("truth", "black", "D", 0.22))


def draw_reevaluation(table: pd.DataFrame) -> Figure:
    """A panel an axis and test-cycle: 95 % interval and value of each detector's SNR, side by side.

    Parameters
    ----------
    table : DataFrame
        From `wearscope.evaluation.reevaluation.compare_sides`.
    """
    rows = table[table["question"] == "snr"]
    panels = list(rows.groupby(["cycle", "axis"], sort=True))
    with figure_style():
        figure = new_figure(1.2 + 2.6 * len(panels), 2.9)
        axes = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
        for ax, ((cycle, axis), part) in zip(axes, panels, strict=True):
            part = part.sort_values("fda", kind="stable")
            place = np.arange(len(part), dtype=float)
            for side, colour, marker, shift in _SIDES:
                value = part[side].to_numpy(dtype=float)
                if not np.isfinite(value).any():
                    continue
                low, high = (part[f"{side}_{end}"].to_numpy(dtype=float) for end in ("low", "high"))
                ax.vlines(place + shift, low, high, color=colour, lw=2.2, alpha=0.5)
                ax.plot(place + shift, value, marker, color=colour, ms=5, ls="none", label=side)
            ax.set_xticks(place, list(part["fda"]))
            ax.set_title(f"axis {axis}, {words(cycle)}", fontsize=9)
            ax.set_yscale("symlog", linthresh=1.0)
            ax.yaxis.set_major_formatter("{x:g}")
            ax.grid(axis="y")
        axes[0].set_ylabel("signal-to-noise ratio")
        axes[-1].legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
    return figure
