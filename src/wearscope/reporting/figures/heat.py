"""Heat maps with numbers in them; what is missing is hatched and says n/a."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib import colormaps
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
    shape = values.shape
    colours = colormaps[cmap] if isinstance(cmap, str) else cmap
    mesh = ax.pcolormesh(
        np.ma.masked_invalid(values), cmap=colours, norm=norm, edgecolors="white", linewidth=0.5
    )
    ax.set_ylim(shape[0], 0)
    ax.set_xlim(0, shape[1])
    ax.set_xticks(np.arange(shape[1]) + 0.5, columns)
    ax.set_yticks(np.arange(shape[0]) + 0.5, rows)
    ax.tick_params(length=0)
    for side in ("left", "bottom"):
        ax.spines[side].set_visible(False)
    for i, j in np.ndindex(*shape):
        value = float(values[i, j])
        if not np.isfinite(value):
            ax.add_patch(Rectangle((j, i), 1, 1, fc=MISSING, ec="#999999", hatch="////", lw=0.0))
        if text is not None:
            label = text(value) if np.isfinite(value) or np.isinf(value) else "n/a"
            ink = ink_on(colours(norm(value))) if np.isfinite(value) else "black"
            ax.text(j + 0.5, i + 0.5, label, ha="center", va="center", fontsize=size, color=ink)
    return mesh


def ink_on(colour: Sequence[float]) -> str:
    """Black or white, whichever is easier to read on an RGBA colour."""
    red, green, blue = (float(part) for part in colour[:3])
    return "black" if 0.299 * red + 0.587 * green + 0.114 * blue > 0.55 else "white"
