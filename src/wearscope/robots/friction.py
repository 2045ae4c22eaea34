"""Friction torque of a robot's wearing joints over speed, temperature and wear, as its model has it.

Eq. (17) of a joint follows from two figures, its Coulomb torque and its viscous slope. A model that lacks
wear and temperature has them carried over, scaled to its joints' own friction.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd

from wearscope.effects.base import Effect, Signals, load_effect
from wearscope.errors import InputError
from wearscope.robots.model import RobotModel

#: Effects that are torque against speed at a joint, whatever its position and load.
SPEED_SIGNALS = {"qd_{joint}", "sign_qd_{joint}", "temp_{joint}", "wear_{joint}"}


def friction_curves(
    model: RobotModel,
    temperatures: Sequence[float] = (30.0, 50.0, 70.0),
    wear: Sequence[float] = (0.0, 50.0),
    points: int = 200,
) -> pd.DataFrame:
    """Friction torque against speed, up to the speed limit.

    Parameters
    ----------
    model : RobotModel
    temperatures : sequence of float
        [deg C]
    wear : sequence of float
        Levels f of eq. (17) [-].
    points : int
        Speeds a curve, closer together near rest, where the law bends.

    Returns
    -------
    DataFrame
        ``robot``, ``joint``, ``speed``, ``temperature``, ``wear``, ``torque``, ``speed_unit``,
        ``torque_unit``: one row a wearing joint, temperature, wear level and speed.

    Raises
    ------
    InputError
        Where the model states no speed limit.
    """
    limits = model.motion_limits()[0]
    parts = []
    for name in model.wear_joints:
        joint = model.joints.index(name)
        speed = limits[joint] * np.geomspace(1e-3, 1.0, points)
        for temperature in temperatures:
            for level in wear:
                parts.append(
                    pd.DataFrame(
                        {
                            "robot": model.name,
                            "joint": name,
                            "speed": speed,
                            "temperature": float(temperature),
                            "wear": float(level),
                            "torque": friction_torque(model, joint, speed, temperature, level),
                            "speed_unit": f"{model.position_units[joint]}/s",
                            "torque_unit": model.torque_units[joint],
                        }
                    )
                )
    return pd.concat(parts, ignore_index=True)


def friction_torque(
    model: RobotModel, joint: int, speed: np.ndarray, temperature: float, level: float = 0.0
) -> np.ndarray:
    """Friction torque (N,) of a joint at speeds (N,), a temperature [deg C] and a wear level f [-]."""
    v = np.zeros((len(speed), model.n))
    v[:, joint] = speed
    signals = Signals.along(np.arange(len(speed), dtype=float), v, temperature=temperature, wear=level)
    torque = np.zeros(len(speed))
    for entry in model.effects:
        effect = load_effect(entry.effect)
        if entry.joint == model.joints[joint] and effect.row and set(effect.depends_on) <= SPEED_SIGNALS:
            torque += effect.torque(signals, joint, entry.parameters)
    return torque


# Normalised law of an industrial robot's joint, with speeds of the motor [rad/s] and temperatures [deg C],
# recalled from Bittencourt's papers: config/robots/medium/README.md.
_COULOMB = 3.11e-2
_STRIBECK = (-2.50e-2, 1.60e-3)
_STRIBECK_SPEED = (-24.81, 0.98)
_VISCOUS = (1.30e-4, 1.32e-3, 20.71)
#: Range of temperatures over which the viscous line is fitted, and the temperature of the stated slope [deg
#: C].
_FITTED, _STATED = (30.0, 70.0), 40.0
#: Wear of one unit of f: low-speed torque over the largest torque, motor speed [rad/s], normalised slope.
_WEAR, _WEAR_SPEED, _WEAR_SLOPE = 1e-3, 0.4, 5e-6

SOURCE = (
    "eq. (17) with the assumed normalised law of config/robots/medium/README.md, scaled to the joint's "
    "Coulomb torque and viscous slope; wear assumed"
)


def scale_friction_law(coulomb: float, viscous: float, gear_ratio: float) -> dict[str, float]:
    """Parameters of `friction_wear_temperature` at a joint.

    Parameters
    ----------
    coulomb : float
        Coulomb torque on the joint side [N m or N]: eta0.
    viscous : float
        Viscous slope at 40 deg C on the joint side [N m s/rad or N s/m].
    gear_ratio : float
        Motor rad per unit of the joint; its sign does not matter.

    Returns
    -------
    dict
        eta0 to eta9 and alpha, in joint units.

    Raises
    ------
    InputError
        Where a figure is no friction or no gear ratio.
    """
    if not (np.isfinite(coulomb) and coulomb >= 0.0 and np.isfinite(viscous) and viscous >= 0.0):
        raise InputError(
            f"friction of Coulomb torque {coulomb:g} and viscous slope {viscous:g}: give 0 or more."
        )
    if not np.isfinite(gear_ratio) or gear_ratio == 0.0:
        raise InputError(f"gear ratio {gear_ratio:g}: give motor turns per joint turn, not 0.")
    temperature = np.linspace(*_FITTED, 401)
    base, warm, decay = _VISCOUS
    slope, start = np.polyfit(temperature, base + warm * np.exp(-temperature / decay), 1)
    largest, scale, gear = coulomb / _COULOMB, viscous / (start + _STATED * slope), abs(gear_ratio)
    return {
        "eta0": coulomb,
        "eta1": _STRIBECK[0] * largest,
        "eta2": _STRIBECK[1] * largest,
        "eta3": _STRIBECK_SPEED[0] / gear,
        "eta4": _STRIBECK_SPEED[1] / gear,
        "eta5": float(start * scale),
        "eta6": float(slope * scale),
        "eta7": _WEAR * largest,
        "eta8": _WEAR_SPEED / gear,
        "eta9": _WEAR_SLOPE * scale,
        "alpha": 1.0,
    }


def friction_from_efficiency(
    efficiency: float, rated_torque: float, rated_speed: float
) -> tuple[float, float]:
    """Coulomb torque and viscous slope of a gear of stated efficiency at its rated torque and speed.

    What the motor supplies beyond the rated torque is ``rated_torque (1 / efficiency - 1)``; half of it is
    taken to be Coulomb and half viscous friction, as neither is stated.

    Parameters
    ----------
    efficiency : float
        Output power over input power, in (0, 1).
    rated_torque, rated_speed : float
        On the joint side [N m or N; rad/s or m/s].

    Raises
    ------
    InputError
        Where the efficiency is no share.
    """
    if not 0.0 < efficiency < 1.0:
        raise InputError(f"efficiency {efficiency:g}: give a share between 0 and 1, e.g. 0.85.")
    loss = rated_torque * (1.0 / efficiency - 1.0)
    return 0.5 * loss, 0.5 * loss / rated_speed


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
