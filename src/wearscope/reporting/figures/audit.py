"""Surrogates against direct simulation."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wearscope.reporting.figures.snr import _STEP
from wearscope.reporting.labels import count_text, finite
from wearscope.reporting.style import WARNING, colours, figure_style, markers, new_figure


def point_label(row: pd.Series) -> str:
    """Why a point is audited, in a few signs: z0, or hypothesis, factor and its side."""
    if not row["factor"]:
        return "z⁰"
    side = "−" if row[row["factor"]] < 0 else "+"
    worn = f"\nwear {int(row['worn_axis'])}" if row["worn_axis"] else ""
    return f"{row['hypothesis'].replace('H0', 'H⁰').replace('H1', 'H¹')}\n{row['factor']}{side}{worn}"


def draw_audit(audit: pd.DataFrame) -> Figure:
    """Error of every surrogate at every audited point, in half-widths of its prediction interval.

    Parameters
    ----------
    audit : DataFrame
        From `wearscope.evaluation.audit.audit_table`, with why each point was chosen.
    """
    fdas = sorted(audit["fda"].unique())
    points = audit.drop_duplicates("point").sort_values("point")
    labels = (
        [point_label(row) for _, row in points.iterrows()] if "reason" in audit else list(points["point"])
    )
    half = 0.5 * (audit["high"] - audit["low"]).to_numpy(dtype=float)
    error = (audit["y_direct"] - audit["y_surrogate"]).to_numpy(dtype=float)
    ratio = np.full(len(audit), np.nan)
    np.divide(error, half, out=ratio, where=half > 0)
    table = audit.assign(ratio=ratio, place=audit["point"].map({p: k for k, p in enumerate(points["point"])}))
    reach = 1.15 * float(np.abs(finite(ratio)).max(initial=1.5))
    reach *= 2.0 if reach > 10 else 1.0  # room on a logarithmic scale
    tint, shape = colours(fdas), markers(sorted(audit["robot"].unique()))
    with figure_style():
        figure = new_figure(10.0, 0.7 + 1.8 * len(fdas))
        axes = figure.subplots(len(fdas), 1, squeeze=False, sharex=True, sharey=True)[:, 0]
        for ax, fda in zip(axes, fdas, strict=True):
            _draw_detector(ax, table[table["fda"] == fda], tint[fda], shape, len(points))
        for ax in axes:
            if reach > 10:
                ax.set_yscale("symlog", linthresh=2.0, linscale=1.5)
                ax.yaxis.set_major_formatter("{x:g}")
            ax.set_ylim(-reach, reach)
        axes[-1].set_xticks(range(len(points)), labels)
        figure.supylabel("(direct − surrogate) / half-width of the 95 % prediction interval", fontsize=9)
        for robot, mark in shape.items():
            axes[0].plot([], [], mark, color="#666666", ms=4, label=robot)
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=6)
    return figure


def _draw_detector(ax: Axes, rows: pd.DataFrame, colour: str, shape: dict[str, str], n: int) -> None:
    ax.axhspan(-1, 1, color="#ececec", zorder=0, lw=0)
    ax.axhline(0, color="#999999", lw=0.7)
    fda = rows["fda"].iloc[0]
    good = rows[~rows["failed"]]
    text = f"{fda}  ({int(good['inside'].sum())} of {count_text(len(good), 'value')} inside"
    failed = rows[rows["failed"]]
    if len(failed):
        text += f"; {len(failed)} failed, crossed at the foot"
    unknown = int((~np.isfinite(good["ratio"].to_numpy(dtype=float))).sum())
    if unknown:
        text += f"; {unknown} without an interval, not drawn"
    ax.set_title(text + ")", fontsize=9)
    for robot, part in rows.groupby("robot", sort=True):
        spread = -0.32 + 0.64 * (np.arange(len(part)) * _STEP % 1.0)
        ax.plot(
            part["place"] + spread, part["ratio"], shape[str(robot)], color=colour, ms=3.5, alpha=0.75, mew=0
        )
    for place in failed["place"]:
        ax.plot([place], [0.06], "x", color=WARNING, ms=6, transform=ax.get_xaxis_transform())
    ax.set_xlim(-0.5, n - 0.5)
    for k in range(1, n):
        ax.axvline(k - 0.5, color="#dddddd", lw=0.6)
