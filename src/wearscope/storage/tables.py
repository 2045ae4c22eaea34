"""Writes Parquet tables atomically, with units in the column metadata and page checksums; reads them."""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from wearscope import limits
from wearscope.errors import InputError, describe
from wearscope.storage.files import DamagedFile, write_text, write_whole

__all__ = [
    "DamagedFile", "Parts", "join_tables", "read_arrow", "read_table", "read_units", "to_array", "to_arrow",
    "write_arrow", "write_json", "write_table", "write_text", "write_whole",
]  # fmt: skip

_PARQUET: dict[str, Any] = {"compression": "zstd", "write_page_checksum": True}


def to_arrow(columns: Any, units: Mapping[str, str] | None = None) -> pa.Table:
    """Convert a data frame or a mapping of arrays to an Arrow table, with units as field metadata.

    Parameters
    ----------
    columns : pandas.DataFrame or mapping of str to array (N,)
    units : mapping of str to str, optional
        Unit by column, e.g. ``{"t": "s"}``; other columns have none.
    """
    if isinstance(columns, Mapping):
        table = pa.Table.from_arrays([to_array(x) for x in columns.values()], names=list(columns))
    else:
        table = pa.Table.from_pandas(columns, preserve_index=False)
    units = units or {}
    fields = [
        field.with_metadata({"unit": units[field.name]}) if field.name in units else field
        for field in table.schema
    ]
    return table.cast(pa.schema(fields))


def to_array(values: Any) -> Any:
    """Convert numbers or texts to an Arrow array.

    Common types are converted here because `pyarrow.array` imports pandas, to check for its types. That
    import would cost each simulating process half a second.
    """
    if isinstance(values, pa.Array | pa.ChunkedArray):
        return values
    if isinstance(values, np.ndarray) and values.ndim == 1 and values.dtype.kind in "fiu":
        values = np.ascontiguousarray(values)
        kind = pa.from_numpy_dtype(values.dtype)
        return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(values)])
    if isinstance(values, list) and all(isinstance(one, str) for one in values):
        texts = [one.encode() for one in values]
        ends = np.cumsum([0, *map(len, texts)], dtype=np.int32)
        parts = [None, pa.py_buffer(ends), pa.py_buffer(b"".join(texts))]
        return pa.Array.from_buffers(pa.string(), len(texts), parts)
    return pa.array(values)


def write_arrow(path: str | Path, table: pa.Table, **options: Any) -> None:
    """Write a Parquet file atomically; equal content gives equal bytes.

    Parameters
    ----------
    path : path-like
    table : pyarrow.Table
    **options
        Options of `pyarrow.parquet.write_table`.

    Raises
    ------
    InputError
        If the file cannot be written; no temporary file remains.
    """
    write_whole(path, lambda name: pq.write_table(table, name, **_PARQUET, **options))


def join_tables(path: str | Path, parts: Iterable[Any], units: Mapping[str, str] | None = None) -> int:
    """Write parts one after the other into a single table, each as a row group.

    Only one part is in memory at a time, and a reader can load the rows of one part alone. A single part
    gives the same bytes as `write_table`.

    Parameters
    ----------
    path : path-like
    parts : iterable of pandas.DataFrame or mapping of str to array
        At least one; all with the same columns and types.
    units : mapping of str to str, optional
        Unit by column, as in `write_table`.

    Returns
    -------
    int
        Number of rows written.

    Raises
    ------
    InputError
        If the file cannot be written; no temporary file remains.
    ValueError
        If there is no part, or one has other columns or types than the first.
    """
    rows = 0

    def write(name: str) -> None:
        nonlocal rows
        writer = None
        try:
            for part in parts:
                table = to_arrow(part, units)
                if writer is None:
                    writer = pq.ParquetWriter(name, table.schema, **_PARQUET)
                writer.write_table(table.cast(writer.schema))
                rows += len(table)
        finally:
            if writer is not None:
                writer.close()
        if writer is None:
            raise ValueError(f"{path}: no part to join")

    write_whole(path, write)
    return rows


def write_table(path: str | Path, columns: Any, units: Mapping[str, str] | None = None) -> None:
    """Write a data frame or arrays as a Parquet file, by `write_arrow`.

    Parameters
    ----------
    path : path-like
    columns : pandas.DataFrame or mapping of str to array (N,)
    units : mapping of str to str, optional
        Unit by column, stored in the column's metadata under ``unit``.
    """
    write_arrow(path, to_arrow(columns, units))


def write_json(path: str | Path, content: Any) -> None:
    """Write a JSON file atomically; NaN and infinite numbers become null.

    Parameters
    ----------
    path : path-like
    content : mapping, list, text, number or None
    """
    write_text(path, json.dumps(_replace_missing(content), indent=2) + "\n")


def _replace_missing(content: Any) -> Any:
    """Return a content with None in place of NaN and infinite numbers."""
    if isinstance(content, Mapping):
        return {key: _replace_missing(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_replace_missing(value) for value in content]
    if isinstance(content, float | np.floating):
        return float(content) if np.isfinite(content) else None
    return content


def read_arrow(source: str | Path | bytes, columns: list[str] | None = None, name: str = "") -> pa.Table:
    """Read a Parquet file and check its page checksums.

    A change in the footer may pass this check; the checksum of the file (`check_file`) detects it.

    Parameters
    ----------
    source : path-like or bytes
        The file or its content.
    columns : list of str, optional
        Columns to read; all by default.
    name : str
        Name in messages, if `source` is a content.

    Raises
    ------
    DamagedFile
        If the file is missing, incomplete, no Parquet file, or one of its pages has changed.
    """
    path = Path(name if isinstance(source, bytes) else source)
    try:
        content = source if isinstance(source, bytes) else path.read_bytes()
        # `pq.read_table` would import pandas, which takes half a second.
        with pq.ParquetFile(pa.BufferReader(content), page_checksum_verification=True) as file:
            table = file.read(columns)
        table = table if columns is None else table.select(columns)
    except FileNotFoundError as error:
        raise DamagedFile(path, f"{path}: no such file; run the stage that makes it.") from error
    except MemoryError:
        raise
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        told = f"{path}: not a whole Parquet file ({describe(error)}); delete it and make it again."
        raise DamagedFile(path, told) from error
    return table


def check_unpacked(source: str | Path | bytes, name: str = "") -> int:
    """Refuse a Parquet file that would take too much memory (`limits.UNPACKED_BYTES`), before it is read.

    Parameters
    ----------
    source : path-like or bytes
        The file or its content.
    name : str
        Name in messages, if `source` is a content.

    Returns
    -------
    int
        Size of the decompressed table [bytes].

    Raises
    ------
    InputError
        If the table is too large, has too many columns, or is no regular file.
    DamagedFile
        If it is no Parquet file.
    """
    path = Path(name if isinstance(source, bytes) else source)
    if not isinstance(source, bytes) and path.exists() and not path.is_file():
        raise InputError(f"{path}: is no plain file; give a Parquet file.")
    try:
        if _footer_size(source if isinstance(source, bytes) else path) > limits.FOOTER_BYTES:
            told = f"describes itself in more than {limits.FOOTER_BYTES / 1e6:g} MB"
            raise InputError(f"{path}: {told}; write it again, without metadata.")
        with pq.ParquetFile(pa.BufferReader(source) if isinstance(source, bytes) else path) as file:
            about = file.metadata
    except InputError:
        raise
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = " ".join(str(error).replace(str(path), "it").split())[:200]
        told = f"{path}: cannot be read whole ({reason}); copy the file again, or make it again."
        raise DamagedFile(path, told) from error
    stored = sum(about.row_group(k).total_byte_size for k in range(about.num_row_groups))
    size = max(stored, 8 * about.num_rows * about.num_columns)
    if about.num_columns > limits.COLUMNS:
        raise InputError(
            f"{path}: has {about.num_columns} columns, more than {limits.COLUMNS}; leave out what is unused."
        )
    check_size(size, path)
    return size


def check_size(size: int, path: Path) -> None:
    """Refuse a table whose size in memory [bytes] exceeds `limits.UNPACKED_BYTES`."""
    if size > limits.UNPACKED_BYTES:
        raise InputError(
            f"{path}: takes {size / 1e9:.3g} GB of memory once it is unpacked, more than "
            f"{limits.UNPACKED_BYTES / 1e9:g} GB; give it in several files."
        )


def read_table(path: str | Path, columns: list[str] | None = None) -> Any:
    """Read a Parquet table as a pandas data frame, by `read_arrow`."""
    return to_frame(read_arrow(path, columns), path)


def to_frame(table: pa.Table, where: str | Path) -> Any:
    """Convert an Arrow table to a data frame; metadata of pandas in the file is ignored.

    Raises
    ------
    InputError
        If a column's type has no equivalent in pandas, such as times of an unknown time zone.
    """
    try:
        return table.to_pandas(ignore_metadata=True)
    except (pa.ArrowException, LookupError, ValueError, TypeError, OverflowError) as error:
        raise InputError(
            f"{where}: holds what no table of numbers and texts does ({describe(error)}); make it again."
        ) from None


class Parts:
    """A table in several files. Each iteration reads them again, one after the other, as data frames.

    Parameters
    ----------
    paths : iterable of path-like
    columns : list of str, optional
        Columns to read; all by default.
    """

    def __init__(self, paths: Iterable[str | Path], columns: list[str] | None = None) -> None:
        self.paths, self.columns = list(paths), columns

    def __len__(self) -> int:
        return len(self.paths)

    def __iter__(self) -> Iterator[Any]:
        for path in self.paths:
            yield read_table(path, self.columns)

    def by(self, column: str, kept: Callable[[Any], Any] = lambda rows: rows) -> Iterator[Any]:
        """Yield a data frame for each value of a column; rows with equal values must be adjacent.

        `kept` is applied to each part first, to select rows.
        """
        import pandas as pd

        held: list[Any] = []
        for part in self:
            for value, rows in kept(part).groupby(column, sort=False):
                if held and held[0][column].iloc[0] != value:
                    yield pd.concat(held, ignore_index=True)
                    held = []
                held.append(rows)
        if held:
            yield pd.concat(held, ignore_index=True)


def read_units(path: str | Path) -> dict[str, str]:
    """Return the unit of each column that has one in a Parquet table's metadata."""
    return {
        field.name: field.metadata[b"unit"].decode()
        for field in read_arrow(path).schema
        if field.metadata and b"unit" in field.metadata
    }


def _footer_size(source: Path | bytes) -> int:
    """Return the stated size [bytes] of a Parquet file's footer; 0 if it is no Parquet file."""
    if isinstance(source, bytes):
        end = source[-8:]
    else:
        with source.open("rb") as file:
            file.seek(-min(8, file.seek(0, os.SEEK_END)), os.SEEK_END)
            end = file.read()
    return int.from_bytes(end[:4], "little") if end[4:] == b"PAR1" else 0
