"""What opposes a servo's speed: the back-EMF that is known, and the viscous friction next to it."""

from collections.abc import Sequence
from typing import Any

from wearscope.closed_loop.intake.dataset import Dataset
from wearscope.closed_loop.model.estimation import Estimate
from wearscope.effects.viscous import EFFECT as VISCOUS


def list_speed_torques(dataset: Dataset, estimates: Sequence[Estimate]) -> dict[str, Any]:
    """By servo joint, its law, its back-EMF and the whole coefficient of the speed.

    Parameters
    ----------
    dataset : Dataset
    estimates : sequence of Estimate
        Of the corrected model.

    Returns
    -------
    dict
        By joint: `law`; `back_emf`, which the torque is without; `speed_coefficient`, that and the viscous
        friction, with `ci95` where it was estimated [N m s/rad, or N s/m].
    """
    told: dict[str, Any] = {}
    for joint, servo in dataset.fields.servos.items():
        j = dataset.joints.index(joint)
        value = low = high = servo.back_emf
        for one in estimates:
            if one.entry.joint == j and one.entry.effect.name == VISCOUS.name:
                ends = one.intervals.get("slope", (one.values["slope"],) * 2)
                value, low, high = value + one.values["slope"], low + ends[0], high + ends[1]
        unit = f"{dataset.torque_unit[j]} s/{dataset.position_unit[j]}"
        told[joint] = {
            "law": servo.law,
            "back_emf": servo.back_emf,
            "speed_coefficient": {"value": value, "ci95": [low, high], "unit": unit},
        }
    return told
