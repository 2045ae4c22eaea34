"""The class `Study` for notebooks: results of a study as data frames with units, and figures."""

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
#: Units of the columns of the scope tables. ``coded`` means the unit of coded levels, in which a factor's
#: range has the length 4.
_UNITS = {"delta": "coded", "sigma": "coded", "p_d": "1", "confidence": "1"}
_SCOPES = ("scope", "group_scope")


class Study:
    """Results of a study; a table is read, and its checksums verified, when it is asked for.

    Parameters
    ----------
    folder : path-like
        Folder of the results, such as ``results/paper``, or of the study, with ``config/config.yaml``.

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
        """Return the names of the study's tables."""
        found = [*self.folder.glob("*.parquet"), *self.folder.glob("design/*.parquet")]
        return sorted(path.relative_to(self.folder).with_suffix("").as_posix() for path in found)

    def table(self, name: str, **where: Any) -> pd.DataFrame:
        """Return a table, or its rows with given values.

        Parameters
        ----------
        name : str
            One of `names`.
        **where
            Value, or list of values, by column: ``fda="C"``, ``axis=[1, 2]``.

        Returns
        -------
        DataFrame
            Its ``attrs["units"]`` has the unit by column.

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
        """Return the signal-to-noise ratio of every cell, eq. (11) of Samuelsson et al. (2014); see `table`.

        It is that of the chosen surrogate where the study has one; ``model="full"`` gives that of the
        paper's.
        """
        from wearscope.evaluation.snr import answer_rows

        table = self.table("snr", **where)
        return table if "model" in where else answer_rows(table)

    def ranking(self, **where: Any) -> pd.DataFrame:
        """Return the ranking of the detectors: medians and ranks with intervals; see `table`."""
        return self.table("ranking", **where)

    def scope(self, **where: Any) -> pd.DataFrame:
        """Return the scope: a row for each cell, nuisance, wear increase and deviation; see `table`."""
        return self.table("scope", **where)

    def sensitivity(self, **where: Any) -> pd.DataFrame:
        """Return how much each factor changes a test quantity, compared with wear; see `table`."""
        return self.table("sensitivity", **where)

    def test_quantities(self, **where: Any) -> pd.DataFrame:
        """Return the test quantity y of every detector and simulated run; see `table`."""
        return self.table("test_quantities", **where)

    def summary(self) -> pd.DataFrame:
        """Return the recommendation, one row for all robots together and one for each.

        A row has the detector, the smallest wear that it finds, and counts that tell how sure the choice is.

        Raises
        ------
        InputError
            Where the study has no conclusion yet.
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
        """Return the factors of the study with their natural levels, from the identification design."""
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
        """Draw a figure of the report, or its panels in the place of given axes.

        Parameters
        ----------
        name : {"scope", "sensitivity", "snr"}
        by : sequence of str
            Columns that form the groups, among ``robot``, ``cycle``, ``axis``, ``fda``.
        factor : str, optional
            Nuisance of the scope; by default the first.
        ax : matplotlib axes, optional
            Axes from ``figure.subplots()``, which the panels replace.

        Returns
        -------
        matplotlib figure
            A notebook shows it; ``figure.savefig("snr.svg")`` saves it. With `ax` it is the part of their
            figure that contains the panels. Its ``axes`` are the panels.

        Raises
        ------
        InputError
            Where there is no such figure, the study lacks its table, or the axes do not belong to a grid.
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
        """Return the ranking of groups; it is computed where the study has another grouping."""
        from wearscope.evaluation.ranking import rank_by_median

        ranking = self.ranking()
        grouped = [name for name in ranking.columns if name in _KEYS]
        return ranking if grouped == list(by) else rank_by_median(self.snr(), by=by)


def _give_place(ax: "Axes | None") -> "FigureBase | None":
    """Remove axes from their figure, and return the part of the figure that they occupied."""
    if ax is None:
        return None
    figure, place = ax.figure, ax.get_subplotspec()
    if place is None:
        raise InputError("ax: these axes have no place in a grid; take some of figure.subplots().")
    ax.remove()
    return figure.add_subfigure(place)


def _let_notebook_show_figures() -> None:
    """Run ``%matplotlib inline`` once in a notebook, which otherwise shows only the size of a figure."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if shell is not None and hasattr(shell, "kernel"):
        from matplotlib.figure import Figure

        if Figure not in shell.display_formatter.formatters["image/png"].type_printers:
            shell.run_line_magic("matplotlib", "inline")


def _find_results(folder: Path) -> Path:
    """Return the folder of results, which is given itself or by the study's folder."""
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
    """Return a factor with its range, found from the coded and natural levels of a design."""
    # The map between coded and natural levels is linear.
    coded, natural = design[name], design[f"{name}_natural"]
    first, last = coded.idxmin(), coded.idxmax()
    slope = (natural[last] - natural[first]) / (coded[last] - coded[first])
    middle = natural[first] - slope * coded[first]
    return Factor(
        name, name, "fault" if name == "f" else "nuisance", "", float(middle - 2.0 * slope),
        float(middle + 2.0 * slope), design.attrs["units"].get(f"{name}_natural", ""),
    )  # fmt: skip
