"""Columns of a recording, from Parquet or CSV, as finite numbers."""

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from wearscope import limits
from wearscope.errors import InputError
from wearscope.processes import bound_memory
from wearscope.storage.files import check_plain
from wearscope.storage.tables import check_size, check_unpacked

#: Fewest rows, and shortest time [s], of a run.
LEAST_ROWS, LEAST_TIME = 50, 1.0
#: Separators of a CSV file that are tried where the header holds them.
_SEPARATORS = (",", ";", "\t")
#: First bytes of files that are no CSV, with what they are and the remedy.
_NO_CSV = {
    b"PAR1": "is a Parquet file; call it .parquet",
    b"\x1f\x8b": "is compressed by gzip; unpack it",
    b"PK\x03\x04": "is a zip archive or spreadsheet; save its table as CSV",
    b"\xff\xfe": "is UTF-16 text; save it as UTF-8",
    b"\xfe\xff": "is UTF-16 text; save it as UTF-8",
}


def _read_csv(path: Path) -> pa.Table:
    """CSV with commas, semicolons or tabs, as UTF-8 or Latin-1."""
    with path.open("rb") as file:
        header = file.readline(limits.HEADER_LINE)
    if path.stat().st_size > limits.TABLE_BYTES:
        size = limits.TABLE_BYTES / 1e6
        raise InputError(f"{path}: is larger than {size:g} MB; give it in several files, or as Parquet.")
    for start, told in _NO_CSV.items():
        if header.startswith(start):
            raise InputError(f"{path}: {told}, or correct runs[].file in dataset.yaml.")
    separator = max(_SEPARATORS, key=lambda one: header.count(one.encode()))
    if len(header) == limits.HEADER_LINE or header.count(separator.encode()) >= limits.COLUMNS:
        told = f"has more than {limits.COLUMNS} columns, or {limits.HEADER_LINE} characters in its first line"
        raise InputError(f"{path}: {told}; leave out what is not used.")
    point = "," if separator == ";" and _has_comma(path) else "."

    def read(encoding: str) -> pa.Table:
        return pyarrow.csv.read_csv(
            path,
            read_options=pyarrow.csv.ReadOptions(encoding=encoding),
            parse_options=pyarrow.csv.ParseOptions(delimiter=separator),
            convert_options=pyarrow.csv.ConvertOptions(decimal_point=point),
        )

    try:
        header.decode("utf-8")
        table = read("utf8")
        is_text = [pa.types.is_binary(column.type) for column in table.schema]
    except UnicodeDecodeError:
        return read("latin1")
    return read("latin1") if any(is_text) else table


def _has_comma(path: Path) -> bool:
    """Whether the first rows of a file with semicolons write 1,5 for 1.5."""
    with path.open("rb") as file:
        lines = [file.readline(limits.HEADER_LINE) for _ in range(10)][1:]
    return any(b"," in line for line in lines) and not any(b"." in line for line in lines)


def read_columns(path: Path) -> pd.DataFrame:
    """Table of a recording.

    Raises
    ------
    InputError
        Where the file is missing, no plain file, of another kind, damaged, or names a column twice.
    """
    check_plain(path, np.inf, "correct runs[].file in dataset.yaml or add the file")
    kind = path.suffix.lower()
    if kind not in (".csv", ".parquet"):
        raise InputError(f"{path}: is neither .parquet nor .csv; convert it to one of them.")
    try:
        with bound_memory(path):
            return _read_table(path, kind)
    except (pa.ArrowException, OSError, UnicodeError, ValueError, OverflowError, TypeError) as error:
        if isinstance(error, InputError):
            raise
        told = " ".join(str(error).replace(str(path), "it").split())[:200].rstrip(".")
        remedy = "copy the file again"
        if "CSV parse error" in told:
            remedy += ", or give it one line of column names, nothing above, and as many values in each row"
        raise InputError(f"{path}: cannot be read whole ({told}); {remedy}.") from error


def _read_table(path: Path, kind: str) -> pd.DataFrame:
    if kind == ".csv":
        table = _read_csv(path)
        check_size(table.nbytes, path)
    else:
        check_unpacked(path)
        table = pq.read_table(path, partitioning=None, page_checksum_verification=True)
    for name, times in Counter(table.column_names).items():
        if times > 1:
            raise InputError(f"{path}: column '{name}' stands twice; keep one of them.")
    return table.to_pandas(ignore_metadata=True)


def take_column(path: Path, frame: pd.DataFrame, name: str) -> np.ndarray:
    """One column (N,) as finite numbers.

    Raises
    ------
    InputError
        Where it is missing, holds text, or a value that is no finite number, with its row.
    """
    if name not in frame.columns:
        near = [c for c in map(str, frame.columns) if _bare(c) == name.lower()]
        hint = f"rename '{near[0]}'" if near else "add it, or correct robot.joints"
        if not near and len(frame.columns) == 1 and path.suffix.lower() == ".csv":
            hint = "the file has a single column, so separate its columns by ',', ';' or a tab"
        raise InputError(f"{path}: column '{name}' is missing; {hint}.")
    series = frame[name]
    if not len(series):
        raise InputError(f"{path}: holds 0 rows; a run needs at least {LEAST_ROWS} rows and one second.")
    if not pd.api.types.is_numeric_dtype(series) or pd.api.types.is_bool_dtype(series):
        row, shown = _first_text(series)
        remedy = "give seconds" if name == "t" else "give its plain numbers"
        raise InputError(
            f"{path}: column '{name}' holds text or dates, not numbers (row {row}: {shown}); {remedy}, or "
            "let 'wearscope new dataset' convert the recordings."
        )
    try:
        values = np.array(series.to_numpy(dtype=float, na_value=np.nan))
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: column '{name}' holds no plain numbers; convert it.") from error
    bad = np.flatnonzero(~(np.abs(values) < limits.NUMBER))
    if len(bad):
        raise InputError(
            f"{path}: column '{name}' is no finite number at row {bad[0]} "
            f"({len(bad)} in all); cut or correct these rows."
        )
    return values


def _bare(column: str) -> str:
    """Name of a column without its unit in brackets, in small letters."""
    return re.split(r"[\[(]", column)[0].strip().lower()


def _first_text(series: pd.Series) -> tuple[int, str]:
    """Row and content of the first value that is no number."""
    try:
        row = int(np.argmax(pd.to_numeric(series, errors="coerce").isna().to_numpy()))
    except (TypeError, ValueError, MemoryError):  # memory: one long text that dictionary encoding repeats
        row = 0
    return row, ascii(str(series.iloc[row])[:30])


def take_positions(path: Path, frame: pd.DataFrame, joints: list[str]) -> np.ndarray:
    """Position columns (N, n) of all joints; all must be there."""
    return np.column_stack([take_column(path, frame, f"q_{joint}") for joint in joints])


def take_given(path: Path, frame: pd.DataFrame, kind: str, joints: list[str]) -> np.ndarray | None:
    """Columns (N, n) of one kind, NaN for the joints that have none; None where no joint has."""
    given = [joint for joint in joints if f"{kind}_{joint}" in frame.columns]
    if not given:
        return None
    taken = np.full((len(frame), len(joints)), np.nan)
    for joint in given:
        taken[:, joints.index(joint)] = take_column(path, frame, f"{kind}_{joint}")
    return taken
