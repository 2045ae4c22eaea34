"""The class `Parameter`: a parameter of an effect with its unit, bounds and default."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes
    ----------
    name : str
    unit : str
        Unit, with ``{torque}`` and ``{position}`` for the joint's units (N m and rad, or N and m).
    lower, upper : float
        Physical bounds: a model with a value outside is refused.
    default : float
        Value where a model leaves the parameter out; NaN where a model must state it.
    estimated : bool
        Whether it is estimated from data. False for a shape parameter that selects a signal, or that stays
        fixed while the others are estimated.
    believable : tuple of (float, float) or None
        Narrower bounds for estimates, from machines that are built; None for `lower` and `upper`. The
        effect's file states the source.
    believable_prismatic : tuple of (float, float) or None
        The same for a prismatic joint; None for `believable`.
    shaped : bool
        Of a coefficient, whether its regressor depends on the effect's shape parameters.
    travel, travel_prismatic : float
        Largest believable product of the value and the RMS of the joint's load [rad or m]. At a joint with
        small loads it allows values above `believable`.
    """

    name: str
    unit: str
    lower: float = -np.inf
    upper: float = np.inf
    default: float = 0.0
    estimated: bool = True
    shaped: bool = True
    believable: tuple[float, float] | None = None
    believable_prismatic: tuple[float, float] | None = None
    travel: float = 0.0
    travel_prismatic: float = 0.0

    def unit_at(self, position: str, torque: str) -> str:
        """Return the unit for a joint whose position and torque have the given units."""
        return self.unit.format(position=position, torque=torque)

    def bounds(self, position_unit: str, load: float = np.inf) -> tuple[float, float]:
        """Return the bounds within which a fit may place the parameter.

        Parameters
        ----------
        position_unit : str
            Unit of the joint's position, ``rad`` or ``m``.
        load : float
            RMS of the joint's load, where it is known [N m or N].

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
