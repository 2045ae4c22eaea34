"""Names that mean one planted effect, and the usual form's coefficient nearest to it; see `truth`."""

import numpy as np
from numpy.typing import NDArray

from benchmarks.board.features import Families

Array = NDArray[np.float64]

MARGIN = 0.05
"""Share of an effect's variance that a rival must leave beyond what the effect's own form leaves."""

ONE_COEFFICIENT = {
    "coulomb_asymmetry": "half_difference",
    "viscous_asymmetry": "half_difference",
    "quadratic_viscous": "slope",
    "load_dependent_friction": "coefficient",
    "joint_spring": "stiffness",
}
"""Effects of many forms, the usual one linear in one main parameter, and that parameter's name.

Coulomb friction far from its reversal and the slope of viscous friction are the same in any form.
"""

PLAIN = ("rotor_inertia", "coulomb", "viscous")
"""What every joint may be expected to have."""

SAME_THING = {
    "rotor_inertia_error": ("rotor_inertia", "rotor_inertia_error"),
    "rotor_inertia": ("rotor_inertia", "rotor_inertia_error"),
}
"""Two names of one column."""

CONTAINED = {"presliding_hysteresis": ("coulomb",)}
"""Names of what a planted effect becomes far from its reversals; elsewhere they are no part of its name.

Springs that slip have slid to the last after a while, and are Coulomb friction from then on.
"""


def accepted_names(effect: str) -> tuple[str, ...]:
    """Names that mean the planted effect."""
    return SAME_THING.get(effect, (effect,))


def project_parameter(families: Families, effect: str, torque: list[Array]) -> float | None:
    """Coefficient of the usual form nearest to a planted torque.

    Refitted with it are the declared effects, plain friction and rotor inertia: it is what a perfect fit of
    the usual form would find; None where the form has free shape parameters.
    """
    if effect not in ONE_COEFFICIENT:
        return None
    moving = families.moving()
    target = families.pool(torque)[moving]
    beside = [families.variants(name)[0] for name in PLAIN if name in families.names()]
    together = np.hstack([families.variants(effect)[0], families.declared, *beside])[moving]
    scale = np.sqrt(np.mean(together**2, axis=0)) + 1e-300
    solution, *_ = np.linalg.lstsq(together / scale, target, rcond=1e-10)
    return float(solution[0] / scale[0])
