"""Box plots as in the paper's Figs. 2 and 3."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba

from wearscope.reporting.labels import finite


def draw_boxes(
    ax: Axes, values: Sequence[object], positions: Sequence[float], colour: str, width: float = 0.6
) -> None:
    """Boxes from quartile to quartile, a dotted circle at the median, whiskers of 1.5 boxes, outliers.

    Parameters
    ----------
    ax : Axes
    values : sequence of array
        One box each; NaN and infinite values are left out (say how many next to the figure), an empty box is
        not drawn.
    positions : sequence of float
    colour : str
    width : float
    """
    data = [finite(one) for one in values]
    filled = [k for k, one in enumerate(data) if one.size]
    if not filled:
        return
    line = {"color": colour, "linewidth": 0.9}
    ax.boxplot(
        [data[k] for k in filled],
        positions=[positions[k] for k in filled],
        widths=width,
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": to_rgba(colour, 0.35), "edgecolor": colour, "linewidth": 0.9},
        whiskerprops=line,
        capprops=line,
        medianprops={"linewidth": 0},
        flierprops={"markersize": 2.5, "markeredgecolor": colour},
    )
    at = [positions[k] for k in filled]
    median = [float(np.median(data[k])) for k in filled]
    ax.plot(at, median, "o", mfc="white", mec="black", mew=0.8, ms=4.5, zorder=5)
    ax.plot(at, median, ".", color="black", ms=2.0, zorder=6)


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
