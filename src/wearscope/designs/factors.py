"""Factors with their coded and natural levels; the factors of the paper's Tables 1 and 3."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wearscope.errors import InputError

CODED_LOW = -2.0
CODED_HIGH = 2.0
FAULT = "f"


@dataclass(frozen=True)
class Factor:
    """A factor of the study: the fault, or a nuisance.

    Parameters
    ----------
    name : str
        Column name; the fault is called ``f``.
    description : str
    role : {"fault", "nuisance"}
    kind : str
        What the factor changes in the simulation: ``wear``, ``temperature``, ``dwell``,
        ``payload_mass_error``, or the path of a number of the robot or of a detector. The path ends in `` %``
        where levels are changes in per cent. In a simulated point, a factor of kind ``wear`` is the wear of
        its `axis`.
    low, high : float
        Natural levels at coded -2 and +2, in `unit`; the map between them is linear.
    unit : str
    levels : int
        Number of levels m of a full factorial design, equally spaced over -2..2.
    nominal : float, optional
        Coded level of the nominal point z0, eq. (18); by default -2 (no wear) for wear, 0 for other factors.
    validation_low, validation_high : float, optional
        Natural levels at -2 and +2 of the validation design (Table 3); by default the ends of the inner 80 %
        of the range.
    axis : int, optional
        Axis that a factor of kind wear wears; by default axis k for the k-th such factor.

    Raises
    ------
    InputError
        Where a field is not valid.
    """

    name: str
    description: str
    role: str
    kind: str
    low: float
    high: float
    unit: str = ""
    levels: int = 5
    nominal: float | None = None
    validation_low: float | None = None
    validation_high: float | None = None
    axis: int | None = None

    def __post_init__(self) -> None:
        where = f"factor '{self.name}'"
        if not self.name.isidentifier() or self.name in {"point", "y", "set"}:
            raise InputError(f"{where}: the name is no free column name; use letters, digits, underscores.")
        if self.role not in {"fault", "nuisance"}:
            raise InputError(f"{where}: role is '{self.role}'; use 'fault' or 'nuisance'.")
        if not (np.isfinite(self.low) and np.isfinite(self.high) and self.low < self.high):
            raise InputError(f"{where}: low {self.low} is not below high {self.high}; swap or widen them.")
        if self.levels < 2:
            raise InputError(f"{where}: levels is {self.levels}; give at least 2.")
        if not CODED_LOW <= self.nominal_coded <= CODED_HIGH:
            raise InputError(f"{where}: nominal {self.nominal} is a coded level and must lie in -2..2.")
        low, high = self.validation_range
        if not self.low <= low < high <= self.high:
            raise InputError(
                f"{where}: the validation range {low}..{high} must rise and lie inside "
                f"{self.low}..{self.high}."
            )

    @property
    def nominal_coded(self) -> float:
        """Coded level of the nominal point z0, eq. (18)."""
        if self.nominal is not None:
            return float(self.nominal)
        return CODED_LOW if self.kind == "wear" else 0.0

    @property
    def step(self) -> float:
        """Size of one coded unit in natural units."""
        return (self.high - self.low) / (CODED_HIGH - CODED_LOW)

    @property
    def is_costly(self) -> bool:
        """Whether each level of the factor needs a new motion or a new fit of the detectors."""
        planned = (
            "drive.speed_limit",
            "drive.acceleration_limit",
            "drive.jerk_limit",
            "home.",
            "lower.",
            "upper.",
        )
        return self.kind == "dwell" or self.kind.startswith((*planned, "detectors."))

    @property
    def validation_range(self) -> tuple[float, float]:
        """Natural levels at -2 and +2 of the validation design."""
        span = self.high - self.low
        low = self.low + 0.1 * span if self.validation_low is None else self.validation_low
        high = self.high - 0.1 * span if self.validation_high is None else self.validation_high
        return float(low), float(high)

    def to_natural(self, coded: ArrayLike) -> NDArray[np.float64]:
        """Return natural levels from coded levels of any shape: -2 is `low`, +2 is `high`, linear between."""
        share = (np.asarray(coded, dtype=float) - CODED_LOW) / (CODED_HIGH - CODED_LOW)
        digits = 12 - min(int(np.floor(np.log10(self.high - self.low))), 0)
        return np.round(self.low + share * (self.high - self.low), digits)

    def to_coded(self, natural: ArrayLike) -> NDArray[np.float64]:
        """Return coded levels from natural levels of any shape; the inverse of `to_natural`."""
        share = (np.asarray(natural, dtype=float) - self.low) / (self.high - self.low)
        return np.round(CODED_LOW + share * (CODED_HIGH - CODED_LOW), 12)

    def validation_to_coded(self, level: ArrayLike) -> NDArray[np.float64]:
        """Convert levels -2..2 of the validation design (Table 3) to the coding of the identification design.

        The validation design has the same matrix as the identification design, but its levels are other
        natural values. Surrogates are evaluated in the coding of the identification design.
        """
        low, high = self.validation_range
        share = (np.asarray(level, dtype=float) - CODED_LOW) / (CODED_HIGH - CODED_LOW)
        return self.to_coded(low + share * (high - low))


def check_factors(factors: Sequence[Factor]) -> None:
    """Refuse a set of factors for which no design can be made.

    Raises
    ------
    InputError
        Where names repeat; there is not exactly one fault named ``f``; wear factors exist and ``f`` is not
        the first of them; or wear factors differ in their levels.
    """
    names = [factor.name for factor in factors]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise InputError(f"factors: the name '{repeated[0]}' is used twice; rename one.")
    natural = sorted(set(names) & {f"{name}_natural" for name in names})
    if natural:
        raise InputError(
            f"factors: '{natural[0]}' is the column of another factor's natural levels; rename it."
        )
    faults = [factor.name for factor in factors if factor.role == "fault"]
    if faults != [FAULT]:
        raise InputError(f"factors: the faults are {faults}; declare exactly one, named '{FAULT}'.")
    wear = wear_names(factors)
    if wear and wear[0] != FAULT:
        raise InputError(f"factors: the first wear factor is '{wear[0]}'; put '{FAULT}' before it.")
    ranges = {
        (factor.low, factor.high, factor.nominal_coded, *factor.validation_range)
        for factor in factors
        if factor.kind == "wear"
    }
    if len(ranges) > 1:
        raise InputError(
            "factors: the wear factors differ in range, nominal or validation levels; give all the same, "
            "because one simulation serves every axis."
        )


def wear_names(factors: Sequence[Factor]) -> list[str]:
    """Return the names of the factors of kind wear, in their order."""
    return [factor.name for factor in factors if factor.kind == "wear"]


def wear_by_axis(factors: Sequence[Factor]) -> dict[int, str]:
    """Return by axis the factor that is its wear in a simulated point, in the order of the factors."""
    wear = [factor for factor in factors if factor.kind == "wear"]
    return {k + 1 if factor.axis is None else factor.axis: factor.name for k, factor in enumerate(wear)}


def worn_factor(factors: Sequence[Factor], axis: int) -> str:
    """Return the factor that is the wear of an axis; the fault ``f`` where no factor is of kind wear.

    Raises
    ------
    InputError
        Where there are wear factors, but none for this axis.
    """
    wear = wear_by_axis(factors)
    if wear and axis not in wear:
        raise InputError(
            f"axis {axis}: the factors declare the wear of axes {', '.join(map(str, wear))}; add a wear "
            "factor or drop the axis."
        )
    return wear.get(axis, FAULT)


def nominal_levels(factors: Sequence[Factor]) -> dict[str, float]:
    """Return the coded nominal point z0 by factor, eq. (18)."""
    return {factor.name: factor.nominal_coded for factor in factors}


PAPER_FACTORS: tuple[Factor, ...] = (
    Factor("f", "wear of the tested axis", "fault", "wear", 0, 50, "-", 5, None, 5, 45),
    Factor("w1", "wear of the first other axis", "nuisance", "wear", 0, 50, "-", 5, None, 5, 45),
    Factor("w2", "wear of the second other axis", "nuisance", "wear", 0, 50, "-", 5, None, 5, 45),
    Factor("w3", "joint temperature", "nuisance", "temperature", 30, 70, "degC", 5, None, 35, 63),
    Factor("w4", "point-to-point delay", "nuisance", "dwell", 25, 75, "ms", 5, None, 31, 71),
    Factor("w5", "payload mass error", "nuisance", "payload_mass_error", -10, 10, "%", 5, None, -9, 3),
)
