"""The data dictionary: what every column of every table means."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

FILE = Path(__file__).with_name("tables.yaml")


def read_dictionary(file: Path = FILE) -> dict[str, Any]:
    """Content of ``tables.yaml``: introduction, columns that several tables share, tables."""
    return yaml.safe_load(file.read_text(encoding="utf-8"))


def columns_of(content: dict[str, Any], name: str) -> dict[str, str]:
    """Meaning, the unit in brackets at its end, by column of a table."""
    return {
        column: meaning or content["columns"][column]
        for column, meaning in content["tables"][name]["columns"].items()
    }


def split_meaning(meaning: str) -> tuple[str, str]:
    """Unit and meaning of ``meaning [unit]``."""
    text, _, unit = meaning.rpartition(" [")
    return (unit.rstrip("]"), text) if text and meaning.endswith("]") else ("", meaning)


def compare_columns(
    columns: Iterable[str], described: Iterable[str], factors: Iterable[str]
) -> tuple[set[str], set[str]]:
    """Columns without an entry, and entries without a column.

    Parameters
    ----------
    columns : iterable of str
        Of a table as it was written.
    described : iterable of str
        Entries; ``<factor>`` is any factor, ``<k>`` a number, ``<kind>`` a word, ``<path>`` a number's path.
    factors : iterable of str
    """
    words = {"<factor>": f"({'|'.join(factors)})", "<k>": r"\d+", "<kind>": r"\w+", "<path>": r"[\w. %]+"}
    patterns = {}
    for entry in described:
        pattern = re.escape(entry)
        for word, stands_for in words.items():
            pattern = pattern.replace(re.escape(word), stands_for)
        patterns[entry] = re.compile(pattern)
    columns = list(columns)
    missing = {name for name in columns if not any(p.fullmatch(name) for p in patterns.values())}
    idle = {entry for entry, p in patterns.items() if not any(p.fullmatch(name) for name in columns)}
    return missing, idle
