"""Friction of a robot's joints over speed, temperature and wear.

The parameters of the friction law, eq. (17), follow from a joint's Coulomb torque and viscous slope. A model
whose friction does not depend on wear or temperature takes this dependence from another robot, scaled to the
friction of its own joints.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd

from wearscope.effects.base import Effect, FrictionLaw, Signals, load_effect
from wearscope.errors import InputError
from wearscope.robots.model import RobotModel, add_torques

#: Signals of a friction curve: an effect that depends on these alone is a torque over speed, whatever the
#: joint's position and load.
SPEED_SIGNALS = {"qd_{joint}", "sign_qd_{joint}", "temp_{joint}", "wear_{joint}"}


def friction_curves(
    model: RobotModel,
    temperatures: Sequence[float] = (30.0, 50.0, 70.0),
    wear: Sequence[float] = (0.0, 50.0),
    points: int = 200,
) -> pd.DataFrame:
    """Compute friction curves: torque over speed, up to the speed limit.

    Parameters
    ----------
    model : RobotModel
    temperatures : sequence of float
        [deg C]
    wear : sequence of float
        Wear indices f of eq. (17) [-].
    points : int
        Number of speeds of a curve; they are denser near rest, where the curve bends.

    Returns
    -------
    DataFrame
        ``robot``, ``joint``, ``speed``, ``temperature``, ``wear``, ``torque``, ``speed_unit``,
        ``torque_unit``: one row for each wearing joint, temperature, wear index and speed.

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
    """Return the friction torque (N,) of a joint at speeds (N,), a temperature [deg C] and a wear index f."""
    v = np.zeros((len(speed), model.n))
    v[:, joint] = speed
    signals = Signals.along(np.arange(len(speed), dtype=float), v, temperature=temperature, wear=level)
    rubs = lambda effect: set(effect.depends_on) <= SPEED_SIGNALS  # noqa: E731
    return add_torques(np.zeros(v.shape), model, signals, rubs)[:, joint]


# Normalised law of an industrial robot's joint, with speeds of the motor [rad/s] and temperatures [deg C],
# recalled from Bittencourt's papers: config/robots/medium/README.md.
_COULOMB = 3.11e-2
_STRIBECK = (-2.50e-2, 1.60e-3)
_STRIBECK_SPEED = (-24.81, 0.98)
_VISCOUS = (1.30e-4, 1.32e-3, 20.71)
#: Range of temperatures [deg C] over which viscous friction is fitted by a straight line, and the temperature
#: at which a user states the viscous slope.
_FITTED, _STATED = (30.0, 70.0), 40.0
#: Effect of one unit of wear f: rise of the torque at low speed over the largest torque, motor speed at which
#: that rise fades [rad/s], and rise of the normalised viscous slope.
_WEAR, _WEAR_SPEED, _WEAR_SLOPE = 1e-3, 0.4, 5e-6

SOURCE = (
    "eq. (17) with the assumed normalised law of config/robots/medium/README.md, scaled to the joint's "
    "Coulomb torque and viscous slope; wear assumed"
)


def scale_friction_law(coulomb: float, viscous: float, gear_ratio: float) -> dict[str, float]:
    """Return the parameters of the effect `friction_wear_temperature` at a joint.

    Parameters
    ----------
    coulomb : float
        Coulomb torque on the joint side [N m or N]: eta0.
    viscous : float
        Viscous slope at 40 deg C on the joint side [N m s/rad or N s/m].
    gear_ratio : float
        Motor angle [rad] for a joint rad or m; its sign does not matter.

    Returns
    -------
    dict
        eta0 to eta9 and alpha, in joint units.

    Raises
    ------
    InputError
        Where a number is negative or not finite, or the gear ratio is 0.
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
    """Estimate the Coulomb torque and the viscous slope of a gear from its efficiency.

    At rated torque and speed the friction is ``rated_torque (1 / efficiency - 1)``. Half of it is assumed to
    be Coulomb friction and half viscous, as the efficiency does not tell the shares.

    Parameters
    ----------
    efficiency : float
        Output power over input power, in (0, 1).
    rated_torque, rated_speed : float
        On the joint side [N m or N; rad/s or m/s].

    Raises
    ------
    InputError
        Where the efficiency is not between 0 and 1.
    """
    if not 0.0 < efficiency < 1.0:
        raise InputError(f"efficiency {efficiency:g}: give a share between 0 and 1, e.g. 0.85.")
    loss = rated_torque * (1.0 / efficiency - 1.0)
    return 0.5 * loss, 0.5 * loss / rated_speed


#: Signal on which friction depends, by the name of the dependence in the configuration.
SIGNALS = {"wear": "wear_{joint}", "temperature": "temp_{joint}"}
#: Name of the parameter for the temperature at which an effect is zero.
REFERENCE = "reference"
#: The friction of two joints is compared at these shares of the largest speed that both reach. At these
#: speeds the Stribeck rise of friction near rest has faded.
_SHARES = np.linspace(0.5, 1.0, 21)


def find_lacking(
    model: RobotModel, dependences: Sequence[str] = tuple(SIGNALS), worn: Sequence[int] | None = None
) -> list[tuple[str, str]]:
    """Find the joints whose torque should depend on wear or temperature and does not.

    The joints that wear (or the axes `worn`) should depend on wear, and all joints on temperature. Returns
    pairs (dependence, joint).
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
    """Add to a model the dependence of friction on wear and temperature that another robot has.

    A joint whose friction depends on wear or temperature already is left unchanged. Any other joint gets the
    missing part from the source's joint of the same name, or else of the same position in the list. The part
    is added as an effect of its own. Its torque is scaled by the ratio of the two joints' friction, its speed
    by the ratio of their gears, or of their speed limits where a gear ratio is not stated.

    Parameters
    ----------
    model : RobotModel
        E.g. ``model_after.yaml`` of a diagnosis.
    source : RobotModel
    dependences : sequence of {"wear", "temperature"}
    reference : float
        Temperature at which the model's own friction holds [deg C]; the added torque is zero there.
    worn : sequence of int, optional
        Axes that wear; the model's own by default.

    Returns
    -------
    RobotModel
        The model with the added effects, marked ``assumed``; the same model where nothing is missing.

    Raises
    ------
    InputError
        Where the source lacks the dependence too, or a joint has no friction that gives the scale.
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
    """Scale the parameters of an effect to a joint whose speed and torque are multiples of the first joint's.

    `speed` and `torque` are these multiples. A parameter is multiplied by powers of them according to its
    unit.
    """
    scaled = {}
    for p in effect.parameters:
        if p.name in values:
            above, _, below = p.unit.partition("/")
            power = above.count("{position}") - below.count("{position}")
            scaled[p.name] = float(values[p.name] * torque ** above.count("{torque}") * speed**power)
    return scaled


def _effects_at(model: RobotModel, joint: str) -> Iterator[tuple[Effect, dict[str, float]]]:
    """Yield the effects at a joint with their parameters."""
    for entry in model.effects:
        if entry.joint == joint:
            yield load_effect(entry.effect), entry.parameters


def _lend(
    source: RobotModel, joint: str, dependence: str, reference: float
) -> list[tuple[Effect, dict[str, float]]]:
    """Return the parts of a joint's friction in the source that depend on wear, or on temperature."""
    lent = []
    for effect, values in _effects_at(source, joint):
        if SIGNALS[dependence] not in effect.depends_on:
            continue
        parts = [load_effect(name) for name in (effect.parts if isinstance(effect, FrictionLaw) else ())]
        chosen = [part for part in parts if SIGNALS[dependence] in part.depends_on]
        for part in chosen:
            own = {p.name: values[p.name] for p in part.parameters if p.name in values}
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
    """Return the factors on speed and on torque from the source's joint to the model's joint."""
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
