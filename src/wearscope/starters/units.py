"""Units and sides of positions and torques, told by names and sizes where the user does not say them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope.errors import InputError
from wearscope.robots.spatial import Array
from wearscope.robots.urdf_file import OPEN_LIMIT, Joint
from wearscope.starters.columns import Group
from wearscope.starters.figures import Figures, take_option
from wearscope.starters.groups import choose_groups
from wearscope.starters.mapped import Mapped

#: Positions are in degrees where they go so far [rad], or so far beyond the URDF's limits, as radians.
_FARTHEST, _BEYOND = 4.0 * np.pi, 1.2


def choose_unit(
    read: Sequence[tuple[Path, pd.DataFrame, Any]], ordered: Sequence[Joint], mapped: Mapped
) -> str | None:
    """Unit of the positions of all recordings, where their size tells it of some: a recorder has one unit."""
    turning = [k for k, joint in enumerate(ordered) if joint.kind != "prismatic"]
    if mapped.position_unit is not None or mapped.side != "joint" or not turning:
        return mapped.position_unit
    degrees, largest = [], []
    for file, frame, _ in read:
        group = choose_groups(file, [str(c) for c in frame.columns], [one.name for one in ordered], mapped)
        if group["position"].unit:
            return None
        values = frame[[group["position"].columns[k] for k in turning]]
        size = values.apply(pd.to_numeric, errors="coerce").dropna().to_numpy(dtype=float)
        degrees.append(_are_degrees(size, [ordered[k] for k in turning]))
        largest.append(float(np.abs(size).max(initial=0.0)))
    if all(degrees) or not any(degrees):
        return None
    if np.mean(degrees) > 0.5:
        return "deg"
    worst = int(np.argmax(largest))
    if largest[worst] > _FARTHEST:
        raise InputError(
            f"{read[worst][0]}: its positions reach {largest[worst]:.3g}, as degrees do, and those of most "
            "others do not; give --position-unit rad or --position-unit deg, or leave the file out."
        )
    return "rad"


def position_unit(
    file: Path,
    group: Group,
    values: Array,
    ordered: Sequence[Joint],
    mapped: Mapped,
    notes: list[str],
) -> Array:
    """Factor (n,) from the recorded positions to rad or m, on the side that they are of."""
    turns = np.array([joint.kind != "prismatic" for joint in ordered])
    unit = np.ones(len(ordered))
    if mapped.position_unit is not None:
        unit[:] = {"rad": 1.0, "deg": np.pi / 180.0, "m": 1.0, "mm": 1e-3}[mapped.position_unit]
        largest = np.abs(values[:, turns]).max() if values[:, turns].size else 0.0
        if mapped.position_unit == "deg" and mapped.side == "joint" and largest < 2.0 * np.pi:
            notes.append(
                f"{file.name}: positions are read as degrees, as stated, though none exceeds {largest:.3g}, "
                "which is the size of rad (else --position-unit rad)."
            )
    elif group.unit:
        unit[:] = group.factor
        notes.append(f"{file.name}: positions are in {group.unit}, by their names.")
    elif mapped.side == "joint" and _are_degrees(
        values[:, turns], [one for one in ordered if one.kind != "prismatic"]
    ):
        unit[turns] = np.pi / 180.0
        notes.append(f"{file.name}: positions are taken as degrees, by their size.")
    else:
        notes.append(f"{file.name}: positions are taken as rad (m where a joint slides).")
    return unit


def _are_degrees(values: Array, ordered: Sequence[Joint]) -> bool:
    if not values.size:
        return False
    if np.abs(values).max() > _FARTHEST:
        return True
    for k, joint in enumerate(ordered):
        limit = max(abs(joint.lower), abs(joint.upper))
        farthest = float(np.abs(values[:, k]).max())
        if (
            limit < OPEN_LIMIT
            and farthest > 2.0 * _BEYOND * limit
            and farthest * np.pi / 180.0 <= _BEYOND * limit
        ):
            return True
    return False


def take_ratios(gear: Figures | None, why: str, n: int) -> Array:
    """Gear ratios (n,); `InputError` where they are missing, or hold a 0."""
    if gear is None:
        raise InputError(f"{why}: needs the gear ratios; give --gear-ratio.")
    if np.any(gear.values == 0.0):
        raise InputError("--gear-ratio holds a 0; give motor turns per joint turn.")
    return gear.values


def read_torque(
    file: Path, values: Mapping[str, Array], mapped: Mapped, gear: Figures | None, n: int
) -> tuple[Array, list[str]]:
    """Torque (N, n) on the joint side."""
    if "torque" in values:
        if mapped.torque_side == "motor":
            return values["torque"] * take_ratios(gear, "--torque-side motor", n), [
                f"{file.name}: torques at the motor, times the gear ratio."
            ]
        return values["torque"], [
            f"{file.name}: torques are taken as those at the joint (else --torque-side motor)."
        ]
    constant = take_option("torque-constant", mapped.torque_constant, n)
    if constant is None:
        raise InputError(
            f"{file}: has currents and no torques; give --torque-constant (N m/A at the motor) and "
            "--gear-ratio, or --torque-constant alone where it is N m/A at the joint."
        )
    ratio = np.ones(n) if gear is None else take_ratios(gear, "--current", n)
    told = "times --torque-constant" + ("" if gear is None else " and --gear-ratio")
    return values["current"] * constant.values * ratio, [f"{file.name}: torques are the currents {told}."]
