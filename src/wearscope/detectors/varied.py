"""Options of detectors that are factors of the study: ``detectors.<name>.<option>``."""

import inspect
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import pandas as pd

from wearscope import plugins
from wearscope.designs.factors import Factor
from wearscope.errors import InputError

if TYPE_CHECKING:
    from wearscope.detectors.questions import DetectorSpec

_SECTION = "detectors."
_RELATIVE = " %"


def find_options(factors: Sequence[Factor], name: str) -> dict[str, Factor]:
    """Factor by the option of a detector that it is."""
    found = {}
    for factor in factors:
        if factor.kind.startswith(_SECTION):
            detector, _, option = factor.kind.removeprefix(_SECTION).removesuffix(_RELATIVE).partition(".")
            if detector == name:
                found[option] = factor
    return found


def set_option(
    reference: str, options: Mapping[str, Any], option: str, factor: Factor, level: float
) -> float:
    """Value of a detector's option at a natural level of its factor; whole where its default is.

    Raises
    ------
    InputError
        Where the detector has no such option, or a change in percent of none that is stated.
    """
    factory = plugins.load(reference, "detectors", "DETECTOR")
    known = inspect.signature(factory).parameters
    if option not in known:
        raise InputError(
            f"factors.{factor.name}: detector {reference} has no option '{option}'; it has "
            f"{', '.join(known) or 'none'}."
        )
    stated = options.get(option, known[option].default)
    is_number = isinstance(stated, int | float) and not isinstance(stated, bool)
    if factor.kind.endswith(_RELATIVE):
        if not is_number:
            raise InputError(
                f"factors.{factor.name}: option '{option}' of detector {reference} is no number that a "
                "change in percent could be of; give the option, or the factor's values themselves."
            )
        level = stated * (1.0 + level / 100.0)
    return round(level) if is_number and isinstance(stated, int) else float(level)


def vary_options(
    detectors: "Sequence[DetectorSpec]", designs: Mapping[str, pd.DataFrame], factors: Sequence[Factor]
) -> dict[tuple[str, tuple[str, int]], dict[str, float]]:
    """Options that detectors have at each design point, by detector and (set, point).

    Raises
    ------
    InputError
        As `set_option`.
    """
    varied: dict[tuple[str, tuple[str, int]], dict[str, float]] = {}
    for spec in detectors:
        for option, factor in find_options(factors, spec.name).items():
            for set_name, design in designs.items():
                levels = factor.to_natural(design[factor.name])
                for point, level in zip(design["point"], levels, strict=True):
                    value = set_option(spec.reference, spec.options, option, factor, float(level))
                    varied.setdefault((spec.name, (set_name, int(point))), {})[option] = value
    return varied
