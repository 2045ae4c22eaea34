"""Friction torque of a robot's wearing joints over speed, temperature and wear, as its model has it.

Eq. (17) of a joint follows from two figures, its Coulomb torque and its viscous slope.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from wearscope.effects.base import Signals, load_effect
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
    zero = np.zeros((len(speed), model.n))
    v = zero.copy()
    v[:, joint] = speed
    signals = Signals(
        t=np.arange(len(speed), dtype=float),
        q=zero,
        v=v,
        a=zero,
        sign=np.sign(v),
        load=zero,
        temperature=np.full_like(zero, temperature),
        wear=np.full_like(zero, level),
    )
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
