"""Which planted effects the runs can tell apart at all, settled before any verdict is looked at.

Definition. The planted torque on the training runs, smoothed as in `features`, where the joint moves, is
stripped of what refitting the declared effects absorbs. Of what stays, the truth's own usual form leaves a
share `own` of the variance, and a rival family leaves `rival`. Only families with no more columns than the
truth's own count as rivals, since a larger family that contains the truth is not what a parsimonious reader
would name. The margin is rival - own for the best rival; a planted effect is *separable* where every margin
is at least `MARGIN`, where it is worth at least `MARGIN_NOISE` noise variances, and where the part that is
not absorbed is at least `UNABSORBED` noise RMS and at least a tenth of the effect. Rest is left out because
friction is undetermined there: so an offset is not separable from a Coulomb asymmetry.
"""

import numpy as np
from numpy.typing import NDArray

from wearscope.attribution_board.features import Families, left_over

Array = NDArray[np.float64]

MARGIN = 0.05
MARGIN_NOISE = 0.0625
UNABSORBED = 0.25

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
}
"""Two names of one column where the declared model has no rotor inertia at all."""


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


def judge_separability(
    families: Families, effect: str, torque: list[Array], sigma: float,
    ripple_order: float | None = None,
) -> dict[str, object]:  # fmt: skip
    """How far a planted torque can be told from the other families on these tracks.

    Parameters
    ----------
    families : Families
        Of the joint in question over the training tracks.
    effect : str
        The planted effect's name; one outside the vocabulary has no family of its own (`own` is 0).
    torque : list of array (N,)
        Its torque by track.
    sigma : float
        Noise RMS of the joint's torque.
    ripple_order : float, optional
        The planted ripple's order, so that its own family has it.

    Returns
    -------
    dict
        `unabsorbed` (RMS over all rows, smoothed), `absorbed_share`, `own`, and `rivals` (name to margin,
        the too small ones).
    """
    moving = families.moving()
    target = families.pool(torque)[moving]
    whole = float(np.sqrt(np.mean(target**2)))
    base = families.declared[moving]
    kept = left_over(target, base)
    own_names = accepted_names(effect)
    own_columns, own = 99, 0.0
    if ripple_order is not None:
        families.ripple_orders = (*families.ripple_orders, ripple_order)
    for name in own_names:
        if name in families.names():
            variants = [variant[moving] for variant in families.variants(name)]
            own_columns = min(variant.shape[1] for variant in variants)
            own = min(left_over(target, np.hstack([base, variant])) for variant in variants) / max(
                kept, 1e-12
            )
    if effect == "payload_error":
        own = 0.0
    rivals: dict[str, float] = {}
    needed = max(MARGIN, MARGIN_NOISE * sigma**2 / max(whole**2 * kept, 1e-300))
    for name in families.names():
        if name in own_names:
            continue
        variants = [x[moving] for x in families.variants(name) if x.shape[1] <= own_columns]
        if not variants:
            continue
        left = min(left_over(target, np.hstack([base, variant])) for variant in variants) / max(kept, 1e-12)
        if left - own < needed:
            rivals[name] = round(left - own, 4)
    return {
        "unabsorbed": whole * float(np.sqrt(kept * moving.mean())),
        "absorbed_share": 1.0 - kept,
        "own": own,
        "rivals": rivals,
    }
