"""Results of a study, for a notebook: tables as data frames with units, and figures."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from markupsafe import escape

from wearscope.designs.factors import Factor
from wearscope.errors import InputError
from wearscope.storage import tables
from wearscope.storage.files import read_json
from wearscope.storage.plain_yaml import read_mapping

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

_KEYS = ("robot", "cycle", "axis", "fda")
_FIGURES = ("scope", "sensitivity", "snr")
#: Units of the columns of the scope: a coded unit is a quarter of a factor's range.
_UNITS = {"delta": "coded", "sigma": "coded", "p_d": "1", "confidence": "1"}
_SCOPES = ("scope", "group_scope")


class Study:
    """Results of a study, read when they are asked for; every byte is checked.

    Parameters
    ----------
    folder : path-like
        The results, such as ``results/paper``, or the study's own folder with ``config/config.yaml``.

    Raises
    ------
    InputError
        Where there are no results.

    Notes
    -----
    Every table is a data frame whose ``attrs["units"]`` has the unit of each column that has one.

    Examples
    --------
    >>> from wearscope import Study
    >>> study = Study("results/paper")
    >>> "snr" in study.names()
    True
    >>> best = study.ranking().fda.iloc[0]
    >>> best in set(study.snr(robot="medium", axis=[1, 2]).fda)
    True
    >>> study.table("validation").attrs["units"]["fit"]
    '%'
    >>> figure = study.plot("snr")
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = _find_results(Path(folder))

    def __repr__(self) -> str:
        return f"Study({str(self.folder)!r})"

    def names(self) -> list[str]:
        """Names of the tables that are there."""
        found = [*self.folder.glob("*.parquet"), *self.folder.glob("design/*.parquet")]
        return sorted(path.relative_to(self.folder).with_suffix("").as_posix() for path in found)

    def table(self, name: str, **where: Any) -> pd.DataFrame:
        """A table, or its rows with given values.

        Parameters
        ----------
        name : str
            One of `names`.
        **where
            Value, or list of values, by column: ``fda="C"``, ``axis=[1, 2]``.

        Returns
        -------
        DataFrame
            With ``attrs["units"]``: unit by column.

        Raises
        ------
        InputError
            Where there is no such table or column, or the file is damaged.
        """
        path = self.folder / f"{name}.parquet"
        if name not in self.names():
            raise InputError(
                f"{self.folder}: has no table '{name}'; it has {', '.join(self.names())}; run the stage that "
                "makes it."
            )
        frame = tables.read_table(path)
        for column, value in where.items():
            if column not in frame.columns:
                raise InputError(f"{path}: has no column '{column}'; it has {', '.join(frame.columns)}.")
            values = [value] if isinstance(value, str) or not isinstance(value, Sequence) else value
            known = set(frame[column])
            for one in values:
                if one not in known:
                    told = ", ".join(sorted(map(str, known))[:20])
                    raise InputError(f"{path}: no row has {column} '{one}'; there are {told}.")
            frame = frame[frame[column].isin(list(values))]
        frame = frame.reset_index(drop=True)
        known_units = {one: unit for one, unit in _UNITS.items() if one in frame and name in _SCOPES}
        frame.attrs["units"] = known_units | tables.read_units(path)
        return frame

    def snr(self, **where: Any) -> pd.DataFrame:
        """Signal-to-noise ratio of every cell, eq. (11) of Samuelsson et al. (2014), as `table` gives it.

        Of the surrogate that answers; ``model="full"`` gives the paper's own.
        """
        from wearscope.evaluation.snr import answer_rows

        table = self.table("snr", **where)
        return table if "model" in where else answer_rows(table)

    def ranking(self, **where: Any) -> pd.DataFrame:
        """Which detector is best: medians and ranks with intervals, as `table` gives it."""
        return self.table("ranking", **where)

    def scope(self, **where: Any) -> pd.DataFrame:
        """Where a detector works: a row a cell, nuisance, wear growth and scatter, as `table` gives it."""
        return self.table("scope", **where)

    def sensitivity(self, **where: Any) -> pd.DataFrame:
        """How much each factor moves a detector in addition to wear, as `table` gives it."""
        return self.table("sensitivity", **where)

    def test_quantities(self, **where: Any) -> pd.DataFrame:
        """The number y of every detector and simulated run, as `table` gives it."""
        return self.table("test_quantities", **where)

    def summary(self) -> pd.DataFrame:
        """What is recommended, a row for all robots and for each: detector, smallest wear, how often it wins.

        Raises
        ------
        InputError
            Where the study did not come so far.
        """
        path = self.folder / "conclusion.json"
        if not path.is_file():
            raise InputError(f"{self.folder}: holds no conclusion yet; run the study with 'wearscope run'.")
        names = ["robot", "detector", "wear", "cells_sure", "cells", "agree", "resamplings", "cells_first"]
        frame = pd.DataFrame(read_json(path, list)).reindex(columns=names)
        frame["robot"] = frame["robot"].replace("", "all")
        frame.attrs["units"] = {"wear": next(one.unit for one in self.factors() if one.name == "f")}
        return frame

    def _repr_html_(self) -> str:
        if not (self.folder / "conclusion.json").is_file():
            return f"<p>{escape(repr(self))}: no conclusion yet</p>"
        return f"<p><strong>{escape(repr(self))}</strong></p>{self.summary().to_html(index=False)}"

    def factors(self) -> list[Factor]:
        """Factors of the study with their natural levels, as the identification design has them."""
        design = self.table("design/identification")
        names = [name for name in design.columns if f"{name}_natural" in design.columns]
        return [_read_factor(design, name) for name in names]

    def plot(
        self,
        name: str,
        *,
        by: Sequence[str] = ("fda",),
        factor: str | None = None,
        ax: "Axes | None" = None,
    ) -> "FigureBase":
        """Draw a figure of the report, or its panels in the place of axes.

        Parameters
        ----------
        name : {"scope", "sensitivity", "snr"}
        by : sequence of str
            Columns that form a group: of ``robot``, ``cycle``, ``axis``, ``fda``.
        factor : str, optional
            Nuisance of the scope; the first that was asked for where left out.
        ax : matplotlib axes, optional
            Of ``figure.subplots()``; the panels take their place.

        Returns
        -------
        matplotlib figure
            A notebook shows it; ``figure.savefig("snr.svg")`` keeps it. With `ax`, the part of their figure
            that has the panels. ``axes`` of either are the panels.

        Raises
        ------
        InputError
            Where there is no such figure, the study lacks its table, or the axes are of no grid.
        """
        from wearscope.reporting import figures

        _let_notebook_show_figures()
        if not set(_KEYS).issuperset(by):
            raise InputError(f"by: {', '.join(by)} is no grouping; use some of {', '.join(_KEYS)}.")
        if name == "sensitivity":
            return figures.draw_sensitivity(self.table("surrogates"), by=by, figure=_give_place(ax))
        if name == "snr":
            return figures.draw_snr(self.snr(), self._rank(by), by, _give_place(ax))
        if name == "scope":
            rows = self.scope()
            known = list(dict.fromkeys(rows["factor"]))
            if factor is not None and factor not in known:
                raise InputError(f"factor: the scope has no '{factor}'; it has {', '.join(known)}.")
            return figures.draw_scope(rows, factor or known[0], self.factors(), by, _give_place(ax))
        raise InputError(f"there is no figure '{name}'; choose one of {', '.join(_FIGURES)}.")

    def _rank(self, by: Sequence[str]) -> pd.DataFrame:
        from wearscope.evaluation.ranking import rank_by_median

        ranking = self.ranking()
        grouped = [name for name in ranking.columns if name in _KEYS]
        return ranking if grouped == list(by) else rank_by_median(self.snr(), by=by)


def _give_place(ax: "Axes | None") -> "FigureBase | None":
    """Take axes off their figure, and return the part of the figure that they had."""
    if ax is None:
        return None
    figure, place = ax.figure, ax.get_subplotspec()
    if place is None:
        raise InputError("ax: these axes have no place in a grid; take some of figure.subplots().")
    ax.remove()
    return figure.add_subfigure(place)


def _let_notebook_show_figures() -> None:
    """Do ``%matplotlib inline`` unless done: without it, a notebook shows only the size of a figure."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if shell is not None and hasattr(shell, "kernel"):
        from matplotlib.figure import Figure

        if Figure not in shell.display_formatter.formatters["image/png"].type_printers:
            shell.run_line_magic("matplotlib", "inline")


def _find_results(folder: Path) -> Path:
    config = folder / "config" / "config.yaml"
    if config.is_file():
        name = read_mapping(config.read_bytes(), str(config)).get("study")
        if not isinstance(name, str):
            raise InputError(f"{config}: study: is missing; give the study a name.")
        folder = folder / "results" / name
    if not any(folder.glob("*.parquet")):
        raise InputError(f"{folder}: holds no results of a study; run it, or name the folder of its results.")
    return folder


def _read_factor(design: pd.DataFrame, name: str) -> Factor:
    # The map between coded and natural levels is linear.
    coded, natural = design[name], design[f"{name}_natural"]
    first, last = coded.idxmin(), coded.idxmax()
    slope = (natural[last] - natural[first]) / (coded[last] - coded[first])
    middle = natural[first] - slope * coded[first]
    return Factor(
        name, name, "fault" if name == "f" else "nuisance", "", float(middle - 2.0 * slope),
        float(middle + 2.0 * slope), design.attrs["units"].get(f"{name}_natural", ""),
    )  # fmt: skip
