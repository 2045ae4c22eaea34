r"""The torque of a servo from what its bus gives: goal, duty, current, supply.

A servo's drive sets a voltage, :math:`u = d\,V` with the duty :math:`d`. The motor turns it into torque at
the joint, :math:`\tau = k\,(u - k\,\dot q) / R` with the torque constant :math:`k` at the joint. The second
part, the back-EMF, opposes the motion like viscous friction does. It is no friction: it follows from the
constants and is subtracted here, so that the estimated viscous friction is the gear's alone.

With its torque off, a drive is open and carries no current. Such rows do not count, although the motor's
torque is known to be zero: the gear then carries the load alone. Friction that grows with the motor's torque
differs there, and some drives brake when they are off.

Source: Duclusaud et al. 2025, "Extended friction models for the physics simulation of servo actuators".
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope.closed_loop.intake.table_files import take_column
from wearscope.errors import InputError
from wearscope.robots.servos import COLUMNS, ServoFields

#: Number of values of a 16-bit register.
_WORD = 65536
#: Signs of duty and position error are compared where the duty exceeds this share of its largest value.
_PLAIN = 0.1
#: The error gives the duty's sign where the sizes of both correlate at least this much.
_FOLLOWS = 0.8


@dataclass(frozen=True)
class Torques:
    """Torques of a recording; of a single servo, arrays are (N,).

    Attributes
    ----------
    tau : ndarray (N, n)
        Torque on the joint side of the gear [N m or N].
    off : ndarray (N, n) of bool
        Rows in which a servo's torque was off.
    notes : tuple of str
    """

    tau: np.ndarray
    off: np.ndarray
    notes: tuple[str, ...] = ()


def take_servo_torque(
    path: Path, frame: pd.DataFrame, joint: str, servo: ServoFields, t: np.ndarray, q: np.ndarray
) -> Torques:
    """Torque of a servo from its columns, by the law that `dataset.yaml` states.

    Parameters
    ----------
    path : Path
    frame : DataFrame
        The recording, with ``goal_``, ``duty_``, ``current_``, ``volts_`` and ``on_`` columns of the joint as
        far as the law needs them.
    joint : str
    servo : ServoFields
    t, q : ndarray (N,)
        Time [s] and position [rad or m].

    Raises
    ------
    InputError
        Where a column that the law needs is missing, or holds impossible values.
    """
    for kind in COLUMNS[servo.law]:
        if f"{kind}_{joint}" not in frame.columns:
            raise InputError(
                f"{path}: column '{kind}_{joint}' is missing, which servo law {servo.law} needs; add it, or "
                "choose another law."
            )
    off = _read_off(path, frame, joint)
    if servo.law == "current":
        current = take_column(path, frame, f"current_{joint}")
        return Torques(np.where(off, 0.0, servo.constant * current), off)
    if servo.law == "duty":
        goal = take_column(path, frame, f"goal_{joint}") if f"goal_{joint}" in frame.columns else None
        counts = take_column(path, frame, f"duty_{joint}")
        duty, notes = restore_duty(f"{path}: column 'duty_{joint}'", counts, servo.duty_full, goal, q, off)
        if goal is not None and (seen := estimate_gain(duty, goal - q, off, servo.duty_limit)) > 0.0:
            stated = "" if servo.gain is None else f", {seen / servo.gain:.3g} times the stated one"
            notes.append(
                f"{path}: the gain of {joint} is {seen:.4g} of full duty for each unit of error{stated}."
            )
    else:
        gain: Any = servo.gain
        if f"gain_{joint}" in frame.columns:
            gain = take_column(path, frame, f"gain_{joint}")
        if gain is None:
            raise InputError(
                f"{path}: column 'gain_{joint}' is missing, and servo states no gain; add one of them."
            )
        duty = gain * (take_column(path, frame, f"goal_{joint}") - q)
        duty, notes = np.clip(duty, -servo.duty_limit, servo.duty_limit), []
    assert servo.resistance is not None
    drive = servo.constant / servo.resistance * duty * _read_volts(path, frame, joint, servo)
    speed = np.gradient(q, t)
    return Torques(np.where(off, 0.0, drive - servo.back_emf * speed), off, tuple(notes))


def estimate_gain(duty: np.ndarray, error: np.ndarray, off: np.ndarray, limit: float) -> float:
    """Position gain of a run: share of full duty per unit of position error [1/rad or 1/m].

    Rows at the duty limit are left out. It is 0 where the duty does not follow the error.
    """
    free = ~off & (np.abs(duty) < 0.98 * limit)
    square = float(np.sum(error[free] ** 2))
    if square == 0.0:
        return 0.0
    gain = float(np.sum(duty[free] * error[free])) / square
    left = float(np.sum((duty[free] - gain * error[free]) ** 2))
    return gain if left < (1.0 - _FOLLOWS**2) * float(np.sum(duty[free] ** 2)) else 0.0


def merge_notes(notes: Sequence[str]) -> list[str]:
    """Notes of the form ``file: text``; notes with the same text are joined."""
    files: dict[str, list[str]] = {}
    for note in notes:
        file, _, text = note.partition(": ")
        files.setdefault(text, []).append(file)
    return [
        f"{', '.join(names[:3])}{f' and {len(names) - 3} more' if len(names) > 3 else ''}: {text}"
        for text, names in files.items()
    ]


def _read_off(path: Path, frame: pd.DataFrame, joint: str) -> np.ndarray:
    """Mask (N,) of rows in which a servo's torque is off; no row where the column is missing."""
    name = f"on_{joint}"
    if name not in frame.columns:
        return np.zeros(len(frame), dtype=bool)
    if pd.api.types.is_bool_dtype(frame[name]):
        return ~frame[name].to_numpy(dtype=bool)
    on = take_column(path, frame, name)
    if not np.all(np.isin(on, (0.0, 1.0))):
        raise InputError(f"{path}: column '{name}' holds other than 0 and 1; give 1 where the torque is on.")
    return on == 0.0


def _read_volts(path: Path, frame: pd.DataFrame, joint: str, servo: ServoFields) -> np.ndarray | float:
    """Supply [V] of a servo: its column (N,), else the value that `servo` states."""
    if f"volts_{joint}" in frame.columns:
        volts = take_column(path, frame, f"volts_{joint}")
        if volts.min() < 0.0:
            raise InputError(
                f"{path}: column 'volts_{joint}' is negative at row {int(volts.argmin())}; correct it."
            )
        return volts
    if servo.volts is None:
        raise InputError(
            f"{path}: column 'volts_{joint}' is missing, and servo states no volts; add one of them."
        )
    return servo.volts


def restore_duty(
    where: str, counts: np.ndarray, full: float, goal: np.ndarray | None, q: np.ndarray, off: np.ndarray
) -> tuple[np.ndarray, list[str]]:
    """Duty (N,) as a share of full duty, its sign restored where the recorder lost it; and notes.

    A recorder that takes a signed register of 16 bits for an unsigned one adds 65536 to negative values. One
    that keeps only the size loses the sign; it is that of the position error, goal less position.

    Raises
    ------
    InputError
        Where values are beyond the full duty either way, or the sign is lost and cannot be told.
    """
    notes = []
    wrapped = counts > _WORD - 1.5 * full
    if full < _WORD / 4 and wrapped.any():
        counts = np.where(wrapped, counts - _WORD, counts)
        notes.append(f"{where} has negative values as 16 bits without a sign; 65536 was taken off them.")
    beyond = np.abs(counts) > 1.1 * full
    if beyond.any():
        raise InputError(
            f"{where} is {counts[beyond][0]:g} at row {int(beyond.argmax())}, beyond duty_full {full:g}; "
            "correct servo.duty_full."
        )
    duty = counts / full
    if goal is None or duty.min() < 0.0:
        return duty, notes
    error = goal - q
    plain = ~off & (np.abs(duty) > _PLAIN * np.abs(duty).max())
    negative = plain & (error < 0.0)
    if negative.sum() < 0.01 * plain.sum() or not negative.any():
        return duty, notes
    if np.corrcoef(duty[plain], np.abs(error[plain]))[0, 1] < _FOLLOWS:
        raise InputError(
            f"{where} is never negative where the goal lies on either side of the position, and does not "
            "follow their distance; record it with its sign."
        )
    notes.append(f"{where} has no sign; it has that of the goal less the position.")
    return duty * np.sign(error), notes


def take_torques(
    path: Path,
    frame: pd.DataFrame,
    joints: list[str],
    servos: Mapping[str, ServoFields],
    t: np.ndarray,
    q: np.ndarray,
) -> Torques:
    """Torques of all joints, as recorded or computed from a servo's columns.

    Parameters
    ----------
    path : Path
    frame : DataFrame
    joints : list of str
    servos : mapping of str to ServoFields
        By joint; the others have a column ``tau_<joint>``.
    t : ndarray (N,)
    q : ndarray (N, n)

    Raises
    ------
    InputError
        Where a column is missing, or holds no torque.
    """
    tau, off = np.empty(q.shape), np.zeros(q.shape, dtype=bool)
    notes: list[str] = []
    for j, joint in enumerate(joints):
        if joint not in servos:
            tau[:, j] = take_column(path, frame, f"tau_{joint}")
            continue
        found = take_servo_torque(path, frame, joint, servos[joint], t, q[:, j])
        tau[:, j], off[:, j] = found.tau, found.off
        notes += [one.replace(str(path), path.name) for one in found.notes]
        if found.off.any():
            count = int(found.off.sum())
            notes.append(f"{path.name}: the torque of {joint} is off in {count} rows; they do not count.")
    return Torques(tau, off, tuple(notes))
