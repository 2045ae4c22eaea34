"""What the readings of the columns are asked of, and what one of them leaves."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wearscope.closed_loop.intake.joint_fit import Rows
from wearscope.closed_loop.intake.products import Fit, Products


@dataclass(frozen=True)
class Asked:
    """Rows as stated, and what their fit leaves.

    Attributes
    ----------
    rows : Rows
    slides : list of bool
        Whether a joint is prismatic.
    joints : list of str
    torque_at : callable
        ``torque_at(delay, order)`` gives the torques (N, n) so many seconds later, or a derivative of them.
    room : ndarray (N,)
        Time to the nearer end of a row's recording [s].
    swapped : callable
        ``swapped(j)`` gives the rows with position and torque of a joint exchanged.
    gear_ratio : list of float or None
    """

    rows: Rows
    slides: list[bool]
    joints: list[str]
    torque_at: Callable[[float, int], np.ndarray]
    room: np.ndarray
    swapped: Callable[[int], Rows]
    gear_ratio: list[float] | None

    def names(self, joints: list[int] | np.ndarray, kind: str = "tau") -> list[str]:
        """Columns of joints."""
        return [f"{kind}_{self.joints[j]}" for j in joints]


@dataclass(frozen=True)
class Reading:
    """A reading, and what it leaves.

    Attributes
    ----------
    told : str
        What is wrong and the remedy, to follow the name of the data set or file.
    codes : tuple of str
        Under which a data set overrules it.
    joints : tuple of int
        Joints that it concerns.
    products : Products
    any_size : bool
        Whether a body of any size is no rival of it.
    shown : bool
        Whether a test of its own shows it, whatever it leaves.
    """

    told: str
    codes: tuple[str, ...]
    joints: tuple[int, ...]
    products: Products
    any_size: bool = False
    shown: bool = False

    @cached_property
    def fit(self) -> Fit:
        """What it leaves."""
        return self.products.fit()


def say_columns(names: list[str]) -> str:
    """Columns as a list in words."""
    quoted = [f"'{name}'" for name in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}"
