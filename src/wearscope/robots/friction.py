"""Friction torque of a robot's wearing joints over speed, temperature and wear, as its model has it."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from wearscope.effects.base import Signals, load_effect
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
