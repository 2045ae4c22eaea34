"""Reads tables of results and formats them as rows of text."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from wearscope import limits
from wearscope.errors import InputError, describe
from wearscope.processes import bound_memory
from wearscope.reporting.labels import COLUMNS, with_unit
from wearscope.storage import tables
from wearscope.storage.files import load_json


def format_value(value: Any) -> str:
    """Return a table's value as short text."""
    if isinstance(value, float):
        return "n/a" if value != value else f"{value:.4g}"
    if value is None or value is pd.NA:
        return "n/a"
    text = str(value)
    return text if len(text) <= limits.CELL else f"{text[: limits.CELL]} ..."


def read_frame(path: Path) -> tuple[pd.DataFrame, dict[str, str]]:
    """Read the table in a file; return it and the units of its columns.

    Raises
    ------
    InputError
        Where it cannot be read as a table.
    """
    try:
        most = limits.JSON_BYTES if path.suffix == ".json" else limits.TABLE_BYTES
        if path.stat().st_size > most:
            raise InputError(f"{path}: is larger than {most / 1e6:g} MB; show a smaller table.")
        with bound_memory(path):
            return _read(path)
    except InputError:
        raise
    except (OSError, ValueError, TypeError, AttributeError, RecursionError, pa.ArrowException) as error:
        raise InputError(f"{path}: cannot be read as a table ({describe(error)}); make it again.") from error


def _read(path: Path) -> tuple[pd.DataFrame, dict[str, str]]:
    """Read a Parquet, CSV or JSON file as a table with units; only Parquet has units."""
    if path.suffix == ".parquet":
        tables.check_unpacked(path)
        return tables.read_table(path), tables.read_units(path)
    if path.suffix == ".csv":
        return pd.read_csv(path), {}
    content = load_json(path.read_text(encoding="utf-8"))
    return pd.json_normalize(content if isinstance(content, list) else [content]).T.reset_index(), {}


def frame_rows(
    frame: pd.DataFrame,
    units: Mapping[str, str],
    where: str,
    conditions: Sequence[str],
    sort: str | None,
    columns: str | None,
    count: int,
    detectors: Mapping[str, str],
) -> tuple[list[str], list[list[str]], int]:
    """Return headers and rows as text, and the number of rows that were left out.

    Parameters
    ----------
    frame : DataFrame
    units : mapping of str to str
        Unit by column.
    where : str
        Name of the table in messages.
    conditions : sequence of str
        Conditions ``column=value`` on the rows.
    sort : str, optional
        Column to sort by; with ``-`` before it, the largest value comes first.
    columns : str, optional
        Columns to show, separated by commas.
    count : int
        Largest number of rows; 0 for all.
    detectors : mapping of str to str
        Full names of detectors by code.

    Raises
    ------
    InputError
        Where there is no such column, or a condition is malformed.
    """
    told = {COLUMNS.get(str(name), str(name)): str(name) for name in frame.columns}

    def known(name: str) -> str:
        name = told.get(name, name)
        if name not in frame.columns:
            raise InputError(f"{where}: has no column '{name}'; it has {', '.join(map(str, frame.columns))}.")
        return name

    try:
        for condition in conditions:
            name, equals, value = condition.partition("=")
            if not equals:
                raise InputError(f"--where {condition}: is no condition; write --where column=value.")
            frame = frame[[_is_equal(one, value) for one in frame[known(name)]]]
        if sort:
            rising = not sort.startswith("-")
            frame = frame.sort_values(known(sort.lstrip("-")), ascending=rising, kind="stable")
    except InputError:
        raise
    except (TypeError, ValueError):  # lists, mappings, or two columns with the same name
        raise InputError(f"{where}: the column has no order; leave out --where and --sort.") from None
    if columns:
        frame = frame[[known(name.strip()) for name in columns.split(",")]]
    elif len(frame):  # columns of matrices, such as covariances, are only useful to programs
        frame = frame.loc[:, [not isinstance(one, list | np.ndarray) for one in frame.iloc[0]]]
    shown = frame.head(count) if count > 0 else frame
    if "fda" in shown:
        shown = shown.assign(fda=shown["fda"].astype(str).replace(dict(detectors)))
    names = {code: name for name, code in told.items()}
    headers = [with_unit(names[str(name)], units.get(str(name), "")) for name in frame.columns]
    rows = [[format_value(value) for value in row] for row in shown.itertuples(index=False)]
    return headers, rows, len(frame) - len(shown)


def _is_equal(value: Any, text: str) -> bool:
    """Return whether a value equals a text, as text or as a number."""
    if str(value) == text:
        return True
    try:
        return float(value) == float(text)
    except (TypeError, ValueError):
        return False
