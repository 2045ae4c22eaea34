"""A reading: a hypothesis of what the columns of a recording hold, as changes of what the data set states."""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Reading:
    """What the columns hold; tuples are over the joints.

    Attributes
    ----------
    torque_sign, factor : tuple of float
        Factor of each torque column, 1 or -1, and of each position column.
    zero : tuple of float
        Offset of each position, added after its factor [rad].
    size : tuple of float
        Ratio of each torque to what the body needs.
    motion_of, torque_of : tuple of int
        Index of the column that holds each joint's position, and of the one that holds its torque.
    crossed : frozenset of int
        Joints whose position and torque columns are exchanged.
    gravity : tuple of float or None
        Gravity in the base frame in place of the stated one [m/s^2].
    without : str
        Whose gravity the torque lacks: ``robot`` (all but the payload's), ``all``, or empty for nobody's.
    delay : tuple of float
        Delay of each run's torques behind its positions at time 0 [s]; empty where there is none.
    drift : float
        Growth of that delay per second, as of two clocks of different rates.
    lag : float
        Time constant of a filter that the torques passed [s].
    clock : float
        True time over the recorded one; negative where the rows run backwards.
    traits : tuple of str
        Names of the hypotheses that differ from what is stated.
    nats : float
        Odds against all traits together.
    """

    torque_sign: tuple[float, ...]
    factor: tuple[float, ...]
    zero: tuple[float, ...]
    size: tuple[float, ...]
    motion_of: tuple[int, ...]
    torque_of: tuple[int, ...]
    crossed: frozenset[int] = frozenset()
    gravity: tuple[float, ...] | None = None
    without: str = ""
    delay: tuple[float, ...] = ()
    drift: float = 0.0
    lag: float = 0.0
    clock: float = 1.0
    traits: tuple[str, ...] = ()
    nats: float = 0.0

    @classmethod
    def stated(cls, n: int) -> "Reading":
        """Reading of n joints whose columns are as stated."""
        one, each = (1.0,) * n, tuple(range(n))
        return cls(one, one, (0.0,) * n, one, each, each)

    def has(self, trait: str, nats: float, **changes: Any) -> "Reading":
        """The same reading with one more trait."""
        names = dict.fromkeys((*self.traits, trait))
        return replace(self, traits=tuple(names), nats=self.nats + nats, **changes)

    def put(self, field: str, joints: list[int], value: float) -> tuple[float, ...]:
        """A field's values, with a given value at some joints."""
        return tuple(value if k in joints else x for k, x in enumerate(getattr(self, field)))

    def times(self, field: str, joints: list[int], by: float) -> tuple[float, ...]:
        """A field's values, multiplied by a factor at some joints."""
        return tuple(x * by if k in joints else x for k, x in enumerate(getattr(self, field)))

    def swap(self, field: str, i: int, j: int) -> tuple[int, ...]:
        """A field's values with those of two joints exchanged."""
        own = list(getattr(self, field))
        own[i], own[j] = own[j], own[i]
        return tuple(own)

    @property
    def moves(self) -> tuple:
        """Fields that change the motion or the body's torque, and so the columns of the fit."""
        return self.motion_of, self.factor, self.zero, self.clock, self.gravity, self.without, self.crossed

    @property
    def claims(self) -> np.ndarray:
        """Joints (n,) whose columns are not as stated; all joints where a trait concerns whole runs."""
        stated, n = Reading.stated(len(self.factor)), len(self.factor)
        names = {field.name for field in fields(self)} - {"crossed", "traits", "nats", "delay"}
        pairs = [(getattr(self, name), getattr(stated, name)) for name in names]
        every = bool(self.delay) or any(x != y for x, y in pairs if not isinstance(y, tuple))
        own = [np.array(x) != np.array(y) for x, y in pairs if isinstance(y, tuple)]
        return np.any([*own, np.isin(np.arange(n), sorted(self.crossed))], axis=0) | every

    @property
    def joint_of(self) -> np.ndarray:
        """Joint (n,) to which each torque column belongs."""
        return np.argsort(self.torque_of)
