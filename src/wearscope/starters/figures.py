"""Figures of a robot by joint, each with where it is from: given, or assumed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wearscope.errors import InputError
from wearscope.robots.spatial import Array


@dataclass(frozen=True)
class Figures:
    """A number a joint.

    Attributes
    ----------
    values : ndarray (n,)
    origins : tuple of str
        By joint: ``given: ...`` or ``assumed: ...``.
    """

    values: Array
    origins: tuple[str, ...]

    @property
    def given(self) -> Array:
        """Which are given (n,)."""
        return np.array([origin.startswith("given") for origin in self.origins])

    def describe(self, joints: Sequence[str]) -> str:
        """Origins in one line; the joints are named where they differ."""
        kinds = list(dict.fromkeys(self.origins))
        if len(kinds) == 1:
            return kinds[0]
        parts = []
        for kind in kinds:
            names = [joint for joint, origin in zip(joints, self.origins, strict=True) if origin == kind]
            parts.append(f"{kind} ({', '.join(names)})")
        return "; ".join(parts)

    def replace(self, values: Array, origin: Callable[[int], str]) -> "Figures":
        """Other values, with another origin where they differ."""
        changed = ~np.isclose(values, self.values, rtol=1e-12, atol=0.0)
        origins = [origin(k) if changed[k] else one for k, one in enumerate(self.origins)]
        return Figures(np.asarray(values, dtype=float), tuple(origins))


def take_option(
    name: str, values: Sequence[float] | None, n: int, lowest: float = 0.0, positive: bool = False
) -> Figures | None:
    """Figures that the user gives: one for all joints, or one a joint; 0 is refused where `positive`.

    Raises
    ------
    InputError
        Where there are neither one nor n, or one is not above `lowest`.
    """
    if values is None or len(values) == 0:
        return None
    if len(values) not in (1, n):
        raise InputError(f"--{name}: has {len(values)} values for {n} joints; give one, or one a joint.")
    taken = np.array(list(values) * (n if len(values) == 1 else 1), dtype=float)
    if not np.all(np.isfinite(taken)) or np.any(taken < lowest) or (positive and np.any(taken <= 0.0)):
        least = "above 0" if positive else f"{lowest:g} or above"
        raise InputError(f"--{name}: holds {taken.min():g}; give finite numbers, {least}.")
    return Figures(taken, (f"given: --{name}",) * n)


def assume(values: Array, why: str) -> Figures:
    """Figures that nobody gave."""
    return Figures(np.asarray(values, dtype=float), (f"assumed: {why}",) * len(values))


def choose(*sources: Figures | None) -> Figures:
    """By joint the first source that has a number; a source lacks one where it is NaN."""
    there = [source for source in sources if source is not None]
    values, origins = there[-1].values.copy(), list(there[-1].origins)
    for source in reversed(there[:-1]):
        for k in np.flatnonzero(np.isfinite(source.values)):
            values[k], origins[k] = source.values[k], source.origins[k]
    return Figures(values, tuple(origins))


def round_figures(values: Any) -> list[float]:
    """Six digits of each, as model files hold them."""
    return [float(f"{value:.6g}") for value in np.asarray(values, dtype=float)]
