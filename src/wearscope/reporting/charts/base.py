"""A chart of a page: an Altair specification, the tables that it draws, and what a reader can choose."""

import base64
import hashlib
import json
import os
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope.reporting.labels import CELL

#: Significant digits of numbers in charts; the Parquet files hold all digits.
DIGITS = 5
#: Columns that name a cell, each with the filter of the same name.
BY_CELL = {key: key for key in CELL}


@dataclass(frozen=True)
class Choice:
    """Something that a reader chooses, from a list or by a slider.

    Options are pairs of a value and its text; the first one is the default where none is given.
    """

    key: str
    label: str
    options: Sequence[tuple[Any, str]]
    default: Any = None
    slides: bool = False

    @property
    def place(self) -> int:
        """Index of the default option."""
        values = [value for value, _ in self.options]
        return values.index(self.default) if self.default in values else 0


@dataclass(frozen=True)
class Source:
    """Rows of one of the page's tables that a chart draws.

    `by` names, for a column, the filter of the page or the choice of the chart whose value it must equal.
    """

    table: str
    by: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Chart:
    """An interactive chart.

    Attributes
    ----------
    name : str
        Its id on the page.
    title : str
    spec : altair chart
        Specification; its data have the names of `sources` (`altair.NamedData`). ``⟦key⟧`` in a title is
        replaced by the label of the chosen value.
    sources : mapping of str to Source
        Data by name. The page lists and exports the first source.
    caption : str
    controls : sequence of Choice
    single : sequence of str
        Choices of which it can show only one value. Where a reader chooses all, it shows the first with rows.
    first : mapping
        Value by choice that is preferred in that case.
    zoom : mapping of str to str
        Scale ("x" or "y") of each field that zooms, see `charts.encoding.add_zoom`; empty without zoom.
    """

    name: str
    title: str
    spec: Any
    sources: Mapping[str, Source]
    caption: str = ""
    controls: Sequence[Choice] = ()
    single: Sequence[str] = ()
    first: Mapping[str, Any] = field(default_factory=dict)
    zoom: Mapping[str, str] = field(default_factory=dict)

    def definition(self) -> dict[str, Any]:
        """Definition for the page's script, in values that JSON can hold."""
        # The specification is not validated here, which would double a page's time; a test does that.
        spec = self.spec.to_dict(validate=False)
        for name in ("$schema", "config"):
            spec.pop(name, None)
        return {
            "spec": spec,
            "sources": {k: {"table": s.table, "by": dict(s.by)} for k, s in self.sources.items()},
            "single": list(self.single),
            "first": dict(self.first),
            "zoom": dict(self.zoom),
            "export": next(iter(self.sources)),
        }


def pack_table(frame: pd.DataFrame) -> str:
    """Table for a page: columns as JSON, gzipped, in base64; equal tables give equal text.

    Numbers keep `DIGITS` significant digits; values that are not finite become null. A column of text becomes
    codes with a list of their values.
    """
    columns: dict[str, Any] = {}
    for name in frame.columns:
        column = frame[name]
        if pd.api.types.is_bool_dtype(column) or pd.api.types.is_integer_dtype(column):
            columns[str(name)] = column.astype(int).tolist()
        elif pd.api.types.is_numeric_dtype(column):
            columns[str(name)] = round_digits(column.to_numpy(dtype=float))
        else:
            codes, values = pd.factorize(column.astype(str), sort=True)
            columns[str(name)] = {"codes": codes.tolist(), "values": [str(value) for value in values]}
    text = json.dumps({"columns": columns}, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    # `gzip.compress` would write the system into its header, depending on the version of Python.
    return base64.b64encode(zlib.compress(text.encode(), 9, wbits=31)).decode("ascii")


def round_digits(values: np.ndarray, digits: int = DIGITS) -> list[float | None]:
    """Values (N,) to some significant digits; None where they are not finite.

    >>> round_digits(np.array([3.14159265, 123456.0, np.nan]), 3)
    [3.14, 123000.0, None]
    """
    shown = np.where(np.abs(values) < 1e-300, 0.0, values).tolist()
    return [float(f"{one:.{digits}g}") if isfinite(one) else None for one in shown]


@cache
def chart_library() -> str:
    """JavaScript of Vega, Vega-Lite and Vega-Embed in one text, from the locked package.

    Making it takes seconds, so it is kept in a file next to the compiled modules.
    """
    import vl_convert

    kept = Path(__file__).parent / "__pycache__" / f"vega-{version('vl-convert-python')}.js"
    with suppress(OSError, UnicodeDecodeError):
        text, _, digest = kept.read_text(encoding="utf-8").rpartition("\n//")
        if hashlib.sha256(text.encode()).hexdigest() == digest:
            return text
    text = str(vl_convert.javascript_bundle())  # type: ignore[call-arg]
    with suppress(OSError):
        own = kept.with_suffix(f".{os.getpid()}")
        own.write_text(f"{text}\n//{hashlib.sha256(text.encode()).hexdigest()}", encoding="utf-8")
        own.replace(kept)
    return text
