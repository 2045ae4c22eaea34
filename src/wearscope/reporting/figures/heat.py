"""Heat maps with numbers in them; what is missing is hatched and says n/a."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Colormap, Normalize
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from wearscope.reporting.style import MISSING


def draw_heat(
    ax: Axes,
    values: NDArray[np.float64],
    rows: Sequence[str],
    columns: Sequence[str],
    norm: Normalize,
    cmap: str | Colormap = "cividis",
    text: Callable[[float], str] | None = None,
    size: float = 7.5,
) -> QuadMesh:
    """Heat map of a matrix, first row at the top.

    Parameters
    ----------
    ax : Axes
    values : array (R, C)
        NaN where there is no value: such a cell is grey, hatched and says n/a.
    rows, columns : sequence of str (R,), (C,)
    norm : Normalize
    cmap : str or Colormap
    text : callable, optional
        Writes a value into its cell.
    size : float
        Of that text [pt].
    """
    import seaborn as sns  # here, because importing it takes a second

    known = np.isfinite(values)
    written = np.array(
        [[text(float(value)) if text else "" for value in row] for row in values], dtype=object
    )
    sns.heatmap(
        np.where(known, values, np.nan), ax=ax, mask=~known, norm=norm, cmap=cmap, cbar=False, linewidths=0.5,
        linecolor="white", annot=None if written is None else np.array(written), fmt="",
        annot_kws={"fontsize": size},
        xticklabels=list(columns), yticklabels=list(rows),
    )  # fmt: skip
    ax.tick_params(length=0, labelrotation=0)
    for i, j in np.argwhere(~known):
        ax.add_patch(Rectangle((j, i), 1, 1, fc=MISSING, ec="#999999", hatch="////", lw=0.0))
        if text is not None:
            label = text(float(values[i, j])) if np.isinf(values[i, j]) else "n/a"
            ax.text(j + 0.5, i + 0.5, label, ha="center", va="center", fontsize=size, color="black")
    return next(one for one in ax.collections if isinstance(one, QuadMesh))
