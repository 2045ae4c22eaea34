"""Parquet tables with units in the column metadata, written whole or not at all."""

import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from wearscope.errors import InputError


def write_whole(path: str | Path, write: Callable[[str], Any]) -> None:
    """Write a file under a temporary name beside `path`, then rename it.

    Parameters
    ----------
    path : path-like
        The file to write; its folder is made.
    write : callable
        Called with the temporary name; writes the content.

    Raises
    ------
    InputError
        Where the disk refuses the file; nothing is left behind.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    os.close(handle)
    try:
        write(temporary)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}); free disk space or choose another place."
        ) from error
    finally:
        if os.path.exists(temporary):
            os.unlink(temporary)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file whole or not at all."""
    write_whole(path, lambda name: Path(name).write_text(text, encoding="utf-8"))


def to_arrow(columns: Any, units: Mapping[str, str] | None = None) -> pa.Table:
    """Arrow table of a data frame or a mapping of arrays, with units as field metadata.

    Parameters
    ----------
    columns : pandas.DataFrame or mapping of str to array (N,)
    units : mapping of str to str, optional
        Unit by column, e.g. ``{"t": "s"}``; columns left out have none.
    """
    if isinstance(columns, Mapping):
        table = pa.table(dict(columns))
    else:
        table = pa.Table.from_pandas(columns, preserve_index=False)
    units = units or {}
    fields = [
        field.with_metadata({"unit": units[field.name]}) if field.name in units else field
        for field in table.schema
    ]
    return table.cast(pa.schema(fields))


def write_table(path: str | Path, columns: Any, units: Mapping[str, str] | None = None) -> None:
    """Write a Parquet table whole or not at all; equal content gives equal bytes.

    Parameters
    ----------
    path : path-like
    columns : pandas.DataFrame or mapping of str to array (N,)
    units : mapping of str to str, optional
        Unit by column, stored in the column's metadata under ``unit``.
    """
    table = to_arrow(columns, units)
    write_whole(path, lambda name: pq.write_table(table, name, compression="zstd"))


def read_table(path: str | Path, columns: list[str] | None = None) -> Any:
    """Read a Parquet table as a pandas data frame.

    Raises
    ------
    InputError
        Where the file is missing or is no whole Parquet file.
    """
    try:
        return pq.read_table(path, columns=columns, partitioning=None).to_pandas()
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; run the stage that makes it.") from error
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(
            f"{path}: not a whole Parquet file ({str(error).splitlines()[0]}); delete it and make it again."
        ) from error


def read_units(path: str | Path) -> dict[str, str]:
    """Units by column as stored in a Parquet table's column metadata."""
    schema = pq.read_schema(path)
    return {
        field.name: field.metadata[b"unit"].decode()
        for field in schema
        if field.metadata and b"unit" in field.metadata
    }
