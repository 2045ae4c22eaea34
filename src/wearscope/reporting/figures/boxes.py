"""Box plots as in the paper's Figs. 2 and 3."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba

from wearscope.reporting.labels import finite


def draw_boxes(ax: Axes, values: Sequence[object], colours: Sequence[str], width: float = 0.6) -> None:
    """Boxes from quartile to quartile, whiskers of 1.5 boxes, outliers; of what is finite.

    Parameters
    ----------
    ax : Axes
    values : sequence of array
        One box each; say how many are not finite next to the figure.
    colours : sequence of str
        Of each box.
    width : float
    """
    look: dict[str, Any] = {"widths": width, "patch_artist": True, "manage_ticks": False}
    for k, (one, colour) in enumerate(zip(values, colours, strict=True)):
        line = {"color": colour, "linewidth": 0.9}
        box = {"facecolor": to_rgba(colour, 0.35), "edgecolor": colour, "linewidth": 0.9}
        ax.boxplot(
            [finite(one)], positions=[k], boxprops=box, whiskerprops=line, capprops=line,
            medianprops={"color": "black", "linewidth": 1.6},
            flierprops={"markersize": 2.5, "markeredgecolor": colour}, **look,
        )  # fmt: skip


def use_symlog(ax: Axes, axis: str, values: object, threshold: float = 1.0) -> bool:
    """Scale an axis linearly within +-`threshold` and logarithmically beyond, where values reach far.

    Returns
    -------
    bool
        Whether it was needed: some value lies beyond 20 thresholds.
    """
    good = np.abs(finite(values))
    if not good.size or good.max() <= 20 * threshold:
        return False
    getattr(ax, f"set_{axis}scale")("symlog", linthresh=threshold, linscale=1.0)
    getattr(ax, f"{axis}axis").set_major_formatter("{x:g}")
    ax.margins(x=0.06) if axis == "x" else ax.margins(y=0.06)
    return True
