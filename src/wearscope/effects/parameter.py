"""A parameter of an effect: its unit, its bounds and its default."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes
    ----------
    name : str
    unit : str
        With ``{torque}`` and ``{position}`` as the joint's units (N m and rad, or N and m).
    lower, upper : float
        Bounds that physics sets: a model with a value outside of them is refused.
    default : float
        Value where a model leaves the parameter out; NaN where it must not.
    estimated : bool
        Whether data estimate it. False for a shape parameter that says which signal is meant, or that an
        estimate is conditioned on.
    believable : tuple of (float, float) or None
        Narrower bounds of the machines that are built, within which data may place it; `lower` and `upper`
        where None. The source stands in the effect's file.
    believable_prismatic : tuple of (float, float) or None
        The same for a joint whose position is in m; `believable` where None.
    travel, travel_prismatic : float
        Largest believable product with the RMS of the joint's load [rad or m]: at a joint of small loads a
        value above `believable` is believed up to there.
    """

    name: str
    unit: str
    lower: float = -np.inf
    upper: float = np.inf
    default: float = 0.0
    estimated: bool = True
    believable: tuple[float, float] | None = None
    believable_prismatic: tuple[float, float] | None = None
    travel: float = 0.0
    travel_prismatic: float = 0.0

    def unit_at(self, position: str, torque: str) -> str:
        """Unit for a joint whose position and torque have the given units."""
        return self.unit.format(position=position, torque=torque)

    def bounds(self, position_unit: str, load: float = np.inf) -> tuple[float, float]:
        """Bounds within which a fit may place the parameter.

        Parameters
        ----------
        position_unit : str
            ``rad`` or ``m``: that of the joint.
        load : float
            RMS of its load, where that is known [N m or N].

        Returns
        -------
        tuple of (float, float)
            Lowest and highest believable value, never outside `lower` and `upper`.
        """
        within = self.believable
        if position_unit == "m" and self.believable_prismatic is not None:
            within = self.believable_prismatic
        low, high = (self.lower, self.upper) if within is None else within
        travel = self.travel_prismatic if position_unit == "m" else self.travel
        return max(low, self.lower), min(max(high, travel / max(load, 1e-12)), self.upper)
