"""Wear and temperature carried over to a model that lacks them, scaled to its joints' own friction."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from wearscope.effects.base import Effect, load_effect
from wearscope.errors import InputError
from wearscope.robots.friction import friction_torque
from wearscope.robots.model import RobotModel

#: Signal of each dependence, by the name that the configuration has for the dependence.
SIGNALS = {"wear": "wear_{joint}", "temperature": "temp_{joint}"}
#: Parameter of an effect that is zero at a temperature.
REFERENCE = "reference"
#: Friction is compared at these shares of the largest speed that both joints reach, where the low-speed bump
#: has died away.
_SHARES = np.linspace(0.5, 1.0, 21)


def find_lacking(
    model: RobotModel, dependences: Sequence[str] = tuple(SIGNALS), worn: Sequence[int] | None = None
) -> list[tuple[str, str]]:
    """Joints whose torque does not depend on wear or temperature, as (dependence, joint).

    Wear is required of the joints that wear, or of the axes `worn`; temperature of all joints.
    """
    wearing = model.wear_joints if worn is None else model.wearing(worn).wear_joints
    return [
        (dependence, joint)
        for dependence in dependences
        for joint in (wearing if dependence == "wear" else model.joints)
        if not any(SIGNALS[dependence] in effect.depends_on for effect, _ in _effects_at(model, joint))
    ]


def carry_over(
    model: RobotModel,
    source: RobotModel,
    dependences: Sequence[str] = tuple(SIGNALS),
    reference: float = 50.0,
    worn: Sequence[int] | None = None,
) -> RobotModel:
    """Complete model: what it lacks of wear and temperature, taken from another robot.

    A joint that depends on wear or temperature already keeps its own, as identified. Where it does not, it
    gets that part of the source's friction, of the joint of the same name or else the same place, as an
    effect of its own: torque times the ratio of the two joints' friction, speed times the ratio of their
    gears (of their speed limits where a gear is not stated).

    Parameters
    ----------
    model : RobotModel
        E.g. ``model_after.yaml`` of a closed loop.
    source : RobotModel
    dependences : sequence of {"wear", "temperature"}
    reference : float
        Temperature at which the model's own friction holds [deg C]: what temperature changes is zero there.
    worn : sequence of int, optional
        Axes that wear; the model's own by default.

    Returns
    -------
    RobotModel
        With further effects, marked ``assumed``; the model itself where it lacks nothing.

    Raises
    ------
    InputError
        Where the source lacks it too, or a joint has no friction to scale to.
    """
    added: list[dict[str, Any]] = []
    for dependence, joint in find_lacking(model, dependences, worn):
        place = model.joints.index(joint)
        lender = joint if joint in source.joints else source.joints[min(place, source.n - 1)]
        speed, torque = _find_scales(model, joint, source, lender, reference)
        for effect, values in _lend(source, lender, dependence, reference):
            added.append(
                {
                    "joint": joint,
                    "effect": effect.label,
                    "parameters": scale_parameters(effect, values, speed, torque),
                    "source": f"assumed, carried over from {lender} of {source.name}: torque times "
                    f"{torque:.4g}, "
                    f"speed times {speed:.4g}",
                    "assumed": True,
                }
            )
    return model.add_effects(added) if added else model


def scale_parameters(
    effect: Effect, values: dict[str, float], speed: float, torque: float
) -> dict[str, float]:
    """Parameters of an effect at a joint with multiples of another's torque and speed, by their units."""
    scaled = {}
    for p in effect.parameters:
        if p.name in values:
            above, _, below = p.unit.partition("/")
            power = above.count("{position}") - below.count("{position}")
            scaled[p.name] = float(values[p.name] * torque ** above.count("{torque}") * speed**power)
    return scaled


def _effects_at(model: RobotModel, joint: str) -> Iterator[tuple[Effect, dict[str, float]]]:
    for entry in model.effects:
        if entry.joint == joint:
            yield load_effect(entry.effect), entry.parameters


def _lend(
    source: RobotModel, joint: str, dependence: str, reference: float
) -> list[tuple[Effect, dict[str, float]]]:
    """The part of a joint's friction in the source that depends on wear, or on temperature."""
    lent = []
    for effect, values in _effects_at(source, joint):
        if SIGNALS[dependence] not in effect.depends_on:
            continue
        parts = [(load_effect(name), kept) for name, kept in effect.parts.items()]
        chosen = [(part, kept) for part, kept in parts if SIGNALS[dependence] in part.depends_on]
        for part, kept in chosen:
            own = {name: values[name] for name in kept if name in values}
            if any(p.name == REFERENCE for p in part.parameters):
                own[REFERENCE] = reference
            lent.append((part, own))
        if not chosen and effect.contains:
            raise InputError(
                f"carry_over: {effect.label} at {joint} of robot '{source.name}' holds other friction too, "
                f"so its {dependence} cannot be lent; name a robot with it as an effect of its own."
            )
        if not chosen:
            lent.append((effect, dict(values)))
    if not lent:
        raise InputError(
            f"carry_over: robot '{source.name}' has no {dependence} at {joint} to lend; name another robot, "
            f"or add an effect that depends on {dependence} to the model file."
        )
    return lent


def _find_scales(
    model: RobotModel, joint: str, source: RobotModel, lender: str, reference: float
) -> tuple[float, float]:
    """Speed and torque of a joint over those of the one that lends."""
    j, k = model.joints.index(joint), source.joints.index(lender)
    limit, lender_limit = model.motion_limits()[0][j], source.motion_limits()[0][k]
    if model.drive.gear_ratio is not None and source.drive.gear_ratio is not None:
        speed = abs(float(source.gear_ratio[k] / model.gear_ratio[j]))
    else:
        speed = float(limit / lender_limit)
    at = _SHARES * min(lender_limit, limit / speed)
    own = float(np.mean(friction_torque(model, j, speed * at, reference)))
    lent = float(np.mean(friction_torque(source, k, at, reference)))
    for robot, name, friction in ((model, joint, own), (source, lender, lent)):
        if not friction > 0.0:
            raise InputError(
                f"carry_over: {name} of robot '{robot.name}' has the friction {friction:.4g} at half its "
                "speed and above, so nothing can be scaled to it; give it friction, or wear and temperature "
                "of its own."
            )
    return speed, own / lent
