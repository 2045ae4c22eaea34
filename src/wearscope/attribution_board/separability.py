"""Names that mean one planted effect, and the usual form's coefficient nearest to it; see `truth`."""

import numpy as np
from numpy.typing import NDArray

from wearscope.attribution_board.features import Families

Array = NDArray[np.float64]

MARGIN = 0.05
"""Share of an effect's variance that a rival must leave beyond what the effect's own form leaves."""

ONE_COEFFICIENT = {
    "coulomb": "level",
    "viscous": "slope",
    "coulomb_asymmetry": "half_difference",
    "viscous_asymmetry": "half_difference",
    "quadratic_viscous": "slope",
    "load_dependent_friction": "coefficient",
    "joint_spring": "stiffness",
}
"""Effects whose usual form is linear in one main parameter, and that parameter's name."""

SAME_THING = {
    "rotor_inertia_error": ("rotor_inertia", "rotor_inertia_error"),
    "rotor_inertia": ("rotor_inertia", "rotor_inertia_error"),
}
"""Two names of one column."""


def accepted_names(effect: str) -> tuple[str, ...]:
    """Names that mean the planted effect."""
    return SAME_THING.get(effect, (effect,))


def project_parameter(families: Families, effect: str, torque: list[Array]) -> float | None:
    """Coefficient of the usual form nearest to a planted torque, the declared effects refitted beside it.

    It is the parameter that a perfect fit of the usual form would find; None where the form has free
    shape parameters.
    """
    if effect not in ONE_COEFFICIENT:
        return None
    moving = families.moving()
    target = families.pool(torque)[moving]
    columns = families.variants(effect)[0]
    together = np.hstack([columns, families.declared])[moving]
    scale = np.sqrt(np.mean(together**2, axis=0)) + 1e-300
    solution, *_ = np.linalg.lstsq(together / scale, target, rcond=1e-10)
    return float(solution[0] / scale[0])
