"""The friction law (17) with temperature and wear, joint by joint."""

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib import colormaps
from matplotlib.figure import Figure

from wearscope.reporting.style import figure_style, new_figure

_DASHES = ("", (4, 1.5), (1, 1), (4, 1.5, 1, 1.5))


def draw_friction(curves: pd.DataFrame) -> Figure:
    """Friction torque against speed: colour is the temperature, line style the wear.

    Parameters
    ----------
    curves : DataFrame
        ``robot``, ``joint``, ``speed``, ``temperature`` [degC], ``wear`` [-], ``torque``, ``speed_unit``,
        ``torque_unit``; speeds of one sign, the law is odd.
    """
    robots = list(dict.fromkeys(curves["robot"]))
    columns = max((len(part["joint"].unique()) for _, part in curves.groupby("robot")), default=1)
    temperatures = sorted(curves["temperature"].unique())
    wear = sorted(curves["wear"].unique())
    shades = colormaps["plasma"](np.linspace(0.05, 0.8, len(temperatures)))
    tint = dict(zip(temperatures, map(tuple, shades), strict=True))
    dashes = {level: _DASHES[k % len(_DASHES)] for k, level in enumerate(wear)}
    with figure_style():
        figure = new_figure(1.0 + 3.0 * columns, 0.9 + 2.4 * len(robots))
        axes = figure.subplots(len(robots), columns, squeeze=False)
        for line, robot in zip(axes, robots, strict=True):
            part = curves[curves["robot"] == robot]
            joints = list(dict.fromkeys(part["joint"]))
            for ax, joint in zip(line, joints, strict=False):
                here = part[part["joint"] == joint]
                sns.lineplot(
                    here, x="speed", y="torque", hue="temperature", style="wear", palette=tint,
                    dashes=dashes, estimator=None, legend=False, ax=ax,
                )  # fmt: skip
                ax.set_title(f"{robot}, {joint}")
                ax.set_xlabel(f"speed [{here['speed_unit'].iloc[0]}]")
                ax.set_ylabel(f"friction torque [{here['torque_unit'].iloc[0]}]")
                ax.set_ylim(bottom=0)
                ax.set_xlim(left=0)
                ax.grid()
            for ax in line[len(joints) :]:
                ax.set_axis_off()
        for temperature in temperatures:
            axes[0, 0].plot([], [], color=tint[temperature], label=f"{temperature:g} °C")
        for level in wear:
            (line,) = axes[0, 0].plot([], [], color="#444444", label=f"wear {level:g}")
            if dashes[level]:
                line.set_dashes(dashes[level])
        figure.legend(loc="outside lower center", ncols=len(temperatures) + len(wear))
    return figure
