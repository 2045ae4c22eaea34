"""Words and symbols that figures and pages use for the names and codes in tables."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from wearscope.storage.files import load_json

if TYPE_CHECKING:
    from wearscope.designs.factors import Factor

#: Name in a verdict for structure outside the vocabulary of effects.
UNKNOWN = "unknown"
#: Columns that name a cell: a robot, test-cycle, axis and detector.
CELL = ("robot", "cycle", "axis", "fda")
MODEL_NAMES = {"main": "main effects", "simplified": "simplified", "full": "full quadratic"}
#: Readable names of the tables' columns.
COLUMNS = {
    "fda": "detector", "cycle": "test-cycle", "n": "cells", "n_nan": "cells n/a", "median": "median SNR",
    "median_low": "95 % from", "median_high": "to", "tied_with": "not told apart from",
    "interval_from": "interval from", "rank_low": "rank from", "rank_high": "rank to",
    "first_reason": "first reason",
}  # fmt: skip
#: Readable names of parameters whose code alone says too little.
PARAMETERS = {
    "eta0": "Coulomb friction", "eta1": "low-speed friction", "eta5": "viscous friction",
    "eta7": "low-speed friction of wear", "eta8": "its speed",
    "eta9": "viscous friction of wear",
    "alpha": "an exponent of low-speed friction", "sine1": "amplitude of the sine of position",
    "cosine1": "amplitude of the cosine of position",
}  # fmt: skip
#: Beginning of the name of a change, up to the joint, where it differs from the effect's own name.
_CHANGES = {"payload_error": "weight on the link of"}
_UNITS = {"degC": "°C", "1": "", "-": ""}


def term_label(term: str) -> str:
    """Regression term as printed: ``w1:w2`` is w1·w2, ``w3^2`` is w3²."""
    return term.replace(":", "·").replace("^2", "²")


def words(value: object) -> str:
    """A name of the configuration as text: point_to_point is point to point."""
    return str(value).replace("_", " ")


def effect_name(code: str) -> str:
    """Readable name of an effect: ``Stribeck friction``; of an own effect, its code as text."""
    # Imported here: it brings compiled code, and a study without a loop does not need it.
    from wearscope.effects.vocabulary import say_effect

    return say_effect(code)


def change_name(code: str, joint: str) -> str:
    """A change between sessions and where it is: ``viscous friction at j2``, ``weight on the link of j2``."""
    return f"{_CHANGES[code]} {joint}" if code in _CHANGES else f"{effect_name(code)} at {joint}"


def parameter_name(code: str) -> str:
    """Readable name of an effect's parameter."""
    return PARAMETERS.get(code, words(code))


def parameter_units(code: str, torque: str) -> dict[str, str]:
    """Units of an effect's parameters at a joint with a unit of torque; empty for an unknown effect."""
    from wearscope.effects.vocabulary import list_effects

    known = next((one.parameters for one in list_effects() if one.name == code), ())
    return {one.name: unit_text(one.unit_at("m" if torque == "N" else "rad", torque)) for one in known}


def detector_name(code: str, use: str) -> str:
    """A detector by what it does and its letter: ``Friction fit (C)``.

    >>> detector_name("P", "own/peak_torque.py")
    'Peak torque (P)'
    """
    stem = use.rpartition("/")[2].removesuffix(".py")
    return f"{words(stem).capitalize()} ({code})"


def read_detector_names(settings: Path) -> dict[str, str]:
    """Full names of detectors by their codes, of a study's settings; empty where they have none."""
    try:
        known = load_json(settings.read_bytes())["detectors"]
        return {code: detector_name(code, one["use"]) for code, one in known.items()}
    except (OSError, AttributeError, KeyError, TypeError, ValueError):
        return {}


def factor_name(factor: "Factor") -> str:
    """Readable name of a factor: ``wear``, or its description, such as ``temperature``."""
    return "wear" if factor.role == "fault" and factor.kind in ("", "wear") else factor.description


def factor_label(factor: "Factor") -> str:
    """Name and unit of a factor, for an axis."""
    return with_unit(factor_name(factor), factor.unit)


def term_name(term: str, factors: Sequence["Factor"]) -> str:
    """Regression term in words: ``w3^2`` is temperature², ``f:w3`` is wear × temperature."""
    return name_term(term, {factor.name: factor_name(factor) for factor in factors})


def name_term(term: str, names: Mapping[str, str]) -> str:
    """Regression term with the factors' names; a code that has none stays."""
    parts = [part.partition("^") for part in term.split(":")]
    return " × ".join(names.get(name, name) + ("²" if power else "") for name, _, power in parts)


def quantity_text(value: float, unit: str, digits: int = 2) -> str:
    """Number and unit: ``4 °C``, ``28``."""
    size = f"{value:.{digits}g}" if abs(value) < 10**digits else f"{value:,.0f}"
    return f"{size} {unit_text(unit)}".strip().replace("-", "\N{MINUS SIGN}")


def term_factors(term: str) -> list[str]:
    """Factors in a regression term."""
    return [] if term == "1" else [part.split("^")[0] for part in term.split(":")]


def unit_text(unit: str) -> str:
    """Unit as printed; empty for a pure number."""
    return _UNITS.get(unit, unit.replace("^2", "²").replace("^b", "ᵇ"))


def with_unit(text: str, unit: str) -> str:
    """Text and unit in brackets, where there is one."""
    return f"{text} [{unit_text(unit)}]" if unit_text(unit) else text


def group_columns(table: pd.DataFrame) -> list[str]:
    """Columns of a table of groups that form the groups."""
    return [name for name in CELL if name in table.columns]


def group_name(by: Sequence[str], key: Sequence[object], names: Mapping[str, str] | None = None) -> str:
    """Name of a group: its values, a detector by one of `names`, an axis with its word; "all" without any."""
    told = names or {}
    parts = [
        f"axis {value}"
        if name == "axis"
        else told.get(str(value), str(value))
        if name == "fda"
        else str(value)
        for name, value in zip(by, key, strict=True)
    ]
    return ", ".join(parts) or "all"


def split_groups(
    table: pd.DataFrame, by: Sequence[str], names: Mapping[str, str] | None = None
) -> Iterator[tuple[str, pd.DataFrame]]:
    """Groups of a table by name, sorted by key; one group called "all" where `by` is empty."""
    if not by:
        yield "all", table
        return
    for key, rows in table.groupby(list(by), sort=True, observed=True):
        yield group_name(by, key if isinstance(key, tuple) else (key,), names), rows


def count_text(n: int, singular: str, plural: str = "") -> str:
    """A number and its noun: 1 cell, 2 cells."""
    return f"{n:,} {singular if n == 1 else plural or singular + 's'}"


def upper_first(text: str) -> str:
    """Text with its first letter as a capital."""
    return f"{text[:1].upper()}{text[1:]}"


def join_words(words: Sequence[str], last: str = "and") -> str:
    """``A``, ``A and B``, ``A, B and C``."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {last} {words[-1]}"


def join_some(words: Sequence[str], most: int = 3) -> str:
    """As `join_words`; of more than `most` words the first, and the number of the others."""
    return join_words([*words[:most], *([f"{len(words) - most} more"] if len(words) > most else [])])


def finite(values: object) -> np.ndarray:
    """Finite values as a float array."""
    array = np.asarray(values, dtype=float)
    return array[np.isfinite(array)]
