"""Box plots as in the paper's Figs. 2 and 3."""

import warnings
from collections.abc import Sequence

import numpy as np
from matplotlib import MatplotlibDeprecationWarning
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
    import seaborn as sns  # here, because importing it takes a second

    data = [finite(one) for one in values]
    filled = [k for k, one in enumerate(data) if one.size]
    if not filled:
        return
    with warnings.catch_warnings():
        # The locked seaborn still says `vert` to matplotlib, which is about to drop it.
        warnings.filterwarnings("ignore", message="vert: bool", category=MatplotlibDeprecationWarning)
        sns.boxplot(
            x=np.repeat([positions[k] for k in filled], [data[k].size for k in filled]),
            y=np.concatenate([data[k] for k in filled]),
            ax=ax,
            native_scale=True,
            width=width,
            saturation=1.0,
            boxprops={"facecolor": to_rgba(colour, 0.35), "edgecolor": colour, "linewidth": 0.9},
            whiskerprops={"color": colour, "linewidth": 0.9},
            capprops={"color": colour, "linewidth": 0.9},
            medianprops={"linewidth": 0},
            flierprops={
                "marker": "o",
                "markersize": 2.5,
                "markeredgecolor": colour,
                "markerfacecolor": "none",
            },
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
    if axis == "y":
        ax.set_yscale("symlog", linthresh=threshold, linscale=1.0)
        ax.yaxis.set_major_formatter("{x:g}")
        ax.margins(y=0.06)
    else:
        ax.set_xscale("symlog", linthresh=threshold, linscale=1.0)
        ax.xaxis.set_major_formatter("{x:g}")
        ax.margins(x=0.06)
    return True
