"""Reads text tables as recorders write them: lines above the header, a row of units, any separator."""

import codecs
import csv
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from wearscope import limits
from wearscope.errors import InputError

_SEPARATORS = ",;\t| "
_COMMENTS = "#%/"
#: The first row of numbers must come within this many lines, and this many characters.
_LOOK, _HEAD = 400, 8_000_000
#: A column holds numbers where more than the first share of its cells do; its other cells count as missing. A
#: line is a row where it has at least the second share of the usual count of numbers.
_NUMBERS, _ROW = 0.5, 0.8
#: The D that Fortran writes before an exponent.
_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d+$)")
#: Typographic minus signs and dashes, read as a minus.
SIGNS = {0x2212: "-", 0x2013: "-"}
#: Largest share of a column's cells that may be damaged numbers.
_FEW_ODD = 0.01


@dataclass(frozen=True)
class _Layout:
    """Layout of a text table: separator, cells of the lines above the numbers, first row, number of cells."""

    separator: str
    above: tuple[list[str], ...]
    begin: int
    cells: int


def read_text(path: Path, columns: Sequence[str] = ()) -> tuple[pd.DataFrame, list[str]]:
    """Read a text file as a table, with notes on how it was read; `InputError` where that is not possible.

    Parameters
    ----------
    path : Path
    columns : sequence of str, optional
        Names of the columns, for a file without names.
    """
    encoding = _find_encoding(path)
    with path.open(encoding=encoding) as file:
        lines = file.read(_HEAD).split("\n", _LOOK)[:_LOOK]
    filled = [line for line in lines if line.strip()]
    if len(filled) < 2:
        what = "a single line" if filled else "empty"
        raise InputError(
            f"{path}: is {what}, and a recording has a header and rows; record it again, or leave it out."
        )
    layout = _find_layout(path, lines)
    if columns and not layout.above:
        if len(columns) != layout.cells:
            raise InputError(
                f"{path}: has {layout.cells} columns, and --columns names {len(columns)}; name each one, in "
                "order."
            )
        layout = replace(layout, above=(list(columns),))
    if layout.cells > limits.COLUMNS:
        told = f"has {layout.cells} columns, more than {limits.COLUMNS}"
        raise InputError(f"{path}: {told}; leave out what is unused.")
    names, units, notes = _name_columns(path, layout)
    commas = layout.separator != "," and _has_decimal_commas(lines[layout.begin :], layout.separator)
    point = "," if commas else "."
    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)  # more values than names
        frame = pd.read_csv(
            path,
            sep=r"\s+" if layout.separator == " " else layout.separator,
            decimal=point,
            encoding=encoding,
            comment="#",
            header=None,
            names=list(range(len(names))),
            skiprows=layout.begin,
            index_col=False,
            skipinitialspace=True,
            low_memory=False,
        )
    if not len(frame):
        raise InputError(f"{path}: holds no row of numbers; record it again, or leave it out.")
    for column in frame.columns:
        if not pd.api.types.is_numeric_dtype(frame[column]):
            frame[column] = _to_numbers(frame[column], point)
    if layout.separator != "," or point != ".":
        notes.append(f"{path.name}: separated by {layout.separator!r}, decimal {point!r}.")
    frame.columns = pd.Index(
        [f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)]
    )
    return _drop_repeated(path, frame, notes), notes


def _find_encoding(path: Path) -> str:
    """Find the encoding: UTF-16 or UTF-32 by its mark, UTF-8 where the whole file is valid, else Latin-1."""
    decoder = codecs.getincrementaldecoder("utf-8")()
    with path.open("rb") as file:
        block = file.read(1 << 20)
        if block[:4] in (codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE):
            return "utf-32"
        if block[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
            return "utf-16"
        try:
            while block:
                decoder.decode(block)
                block = file.read(1 << 20)
            decoder.decode(b"", final=True)
        except UnicodeDecodeError:
            return "latin-1"
    return "utf-8-sig"


def _split(line: str, separator: str) -> list[str]:
    """Split a line into cells."""
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]


def _is_number(text: str) -> bool:
    """Return whether a text is a number, also with a typographic minus or Fortran's exponent."""
    try:
        float(_FORTRAN.sub("e", text.translate(SIGNS)))
        return True
    except ValueError:
        return False


def _count_numbers(line: str, separator: str) -> int:
    """Count the cells of a line that are numbers; a comment has none."""
    if line.lstrip().startswith(tuple(_COMMENTS)):
        return 0
    cells = _split(line, separator)
    return sum(_is_number(one if separator == "," else one.replace(",", ".")) for one in cells)


def _is_row(line: str, separator: str, usual: float) -> bool:
    """Return whether a line has about the usual count of numbers, or only numbers and empty cells."""
    cells = _split(line, separator)
    numbers, filled = _count_numbers(line, separator), sum(bool(cell) for cell in cells)
    return len(cells) >= usual and (numbers >= max(_ROW * usual, 1.0) or numbers == filled > 1)


def _find_layout(path: Path, lines: list[str]) -> _Layout:
    """Find the separator that gives most numbers, and the lines above the first row of numbers."""
    counts = {
        one: np.array([_count_numbers(line, one) for line in lines if line.strip()]) for one in _SEPARATORS
    }
    separator = max(_SEPARATORS, key=lambda one: float(np.median(counts[one][len(counts[one]) // 2 :])))
    usual = float(np.median(counts[separator][len(counts[separator]) // 2 :]))
    if usual < 2.0:
        # With a date next to a single number, or columns of words, counting numbers does not help. Then the
        # separator is the character that every line has.
        some = [line for line in lines if line.strip() and not line.startswith(tuple(_COMMENTS))][:20]
        separator = max(_SEPARATORS, key=lambda one: min((line.count(one) for line in some), default=0))
        if not some or not some[0].count(separator):
            raise InputError(f"{path}: has a single column; separate its columns by ',', ';', a tab or '|'.")
    begin = next((k for k, line in enumerate(lines) if _is_row(line, separator, usual)), len(lines))
    cells = max((len(_split(line, separator)) for line in lines[begin : begin + 20]), default=0)
    above = [_split(line.lstrip(f"{_COMMENTS} "), separator) for line in lines[:begin] if line.strip()]
    return _Layout(separator, tuple(one for one in above if len(one) > 1), begin, cells)


def _name_columns(path: Path, layout: _Layout) -> tuple[list[str], list[str], list[str]]:
    """Return the name and the unit of each column, and notes on how the lines above the numbers were read."""
    above = layout.above
    if not above:
        raise InputError(
            f"{path}: its first line is numbers; give the names of its {layout.cells} columns, in order, "
            "with --columns time,q1,..., or put the columns' names above them."
        )
    wide = [k for k, one in enumerate(above) if len(one) >= layout.cells - 1] or [len(above) - 1]
    told = [len({cell for cell in above[k] if cell}) for k in wide]
    header = wide[int(np.argmax(told))]
    names, joined = above[header], set[int]()
    # Where names repeat, they are only joints or only kinds; the row above or below has the other part.
    for k in (header + 1, header - 1):
        if k in wide and len(set(names)) < len(names):
            upper, lower = (above[one] for one in sorted((header, k)))
            both = _join_names(upper, lower)
            if len(set(both)) == len(both) and not any(map(_is_number, both)):
                names, joined = both, {header, k}
    names = [cell or f"column {k + 1}" for k, cell in enumerate(names)]
    names += [f"column {k + 1}" for k in range(len(names), layout.cells)]
    units = [""] * len(names)
    for k in wide:
        numbers = any(_is_number(cell.replace(",", ".")) for cell in above[k])
        if k > header and k not in joined and not numbers:
            units = [*(cell.strip("[]()") for cell in above[k]), *units][: len(names)]
    notes = []
    if any(units):
        notes.append(f"{path.name}: the row below the columns' names is read as their units.")
    if joined:
        notes.append(f"{path.name}: the columns' names are those of two rows.")
    if header := min({header, *joined}):
        notes.append(f"{path.name}: {header} lines above the columns' names are left out.")
    return names, units, notes


def _join_names(upper: list[str], lower: list[str]) -> list[str]:
    """Join the names of two rows; an empty cell of the upper row repeats the cell to its left."""
    names, last = [], ""
    for k, below in enumerate(lower):
        last = (upper[k] if k < len(upper) else "") or last
        names.append(f"{last} {below}".strip())
    return names


def _has_decimal_commas(lines: list[str], separator: str) -> bool:
    """Return whether more cells are numbers with a decimal comma than with a decimal point."""
    cells = [cell for line in lines if line.strip() for cell in _split(line, separator)]
    forms = [re.compile(rf"[+-]?[\d.,]*{mark}\d*([de][+-]?\d+)?", re.IGNORECASE) for mark in (",", r"\.")]
    commas, points = (sum(form.fullmatch(cell) is not None for cell in cells) for form in forms)
    return commas > points


def _to_numbers(column: pd.Series, point: str) -> pd.Series:
    """Convert a column to numbers; a few cells may be text, and numbers may have thousands separators.

    A column that holds mostly text, or many odd cells, is returned unchanged.
    """
    mark, text = "." if point == "," else ",", column.astype(str).str.strip()
    grouped = text.str.fullmatch(rf"[+-]?\d{{1,3}}(\{mark}\d{{3}})+(\{point}\d*)?")
    text = text.str.translate(SIGNS)
    text = text.str.replace(_FORTRAN, "e", regex=True)
    text = text.where(~grouped, text.str.replace(mark, "", regex=False)).str.replace(point, ".", regex=False)
    numbers = pd.to_numeric(text, errors="coerce")
    most = numbers.notna().sum() > _NUMBERS * column.notna().sum()
    return column if not most or len(find_odd(column, numbers)) else numbers


def find_odd(column: pd.Series, numbers: pd.Series) -> pd.Series:
    """Return the cells that contain digits and are no numbers; none where only a few are damaged.

    A cell of letters alone, such as ``nan`` or ``off``, counts as a missing value.
    """
    odd = column[numbers.isna() & column.notna()].astype(str)
    odd = odd[odd.str.contains(r"\d")]
    return odd if len(odd) > _FEW_ODD * len(column) else odd[:0]


def _drop_repeated(path: Path, frame: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    """Drop columns that repeat name and values of another; refuse those that repeat only the name."""
    again = np.flatnonzero(frame.columns.duplicated())
    for k in again.tolist():
        name = str(frame.columns[k])
        first = list(frame.columns).index(name)
        if not frame.iloc[:, k].equals(frame.iloc[:, first]):
            raise InputError(f"{path}: column '{name}' stands twice with other values; keep one.")
    if len(again):
        told = ", ".join(dict.fromkeys(str(frame.columns[k]) for k in again))
        notes.append(f"{path.name}: columns that stand twice are read once: {told}.")
    return frame.iloc[:, ~frame.columns.duplicated()]
