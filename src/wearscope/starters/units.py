"""Units of positions and torques, and their side of the gear: stated, or told by names and magnitudes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope.errors import InputError
from wearscope.robots.spatial import Array, unwrap_turns
from wearscope.robots.urdf import OPEN_LIMIT, Joint
from wearscope.starters.columns import SHARES, Group, split_name
from wearscope.starters.figures import Figures, take_option
from wearscope.starters.mapped import Mapped, choose_groups


@dataclass(frozen=True)
class _Scale:
    """Units of the positions of revolute or prismatic joints: the platform's and a smaller one."""

    slides: bool
    base: str
    small: str
    factor: float
    farthest: float


#: The last field of each scale is the largest plausible position in the platform's unit [rad or m]. Positions
#: beyond it are in the smaller unit. So are positions far beyond a joint's limit in the URDF that are, in the
#: smaller unit, at most `_BEYOND` times that limit.
_SCALES = (
    _Scale(False, "rad", "deg", np.pi / 180.0, 4.0 * np.pi),
    _Scale(True, "m", "mm", 1e-3, 30.0),
)
_BEYOND = 1.2
#: Positions that are whole numbers and reach beyond this are encoder counts.
_COUNTS = 1440.0


def choose_units(
    read: Sequence[tuple[Path, Path, pd.DataFrame, Any]], ordered: Sequence[Joint], mapped: Mapped
) -> tuple[str, ...]:
    """Choose the unit of positions for all recordings, as one recorder writes one unit.

    A unit that the user states or a column names is kept. Otherwise the magnitudes decide: where some
    recordings look like degrees or mm and others do not, the majority.

    Raises
    ------
    InputError
        Where one recording contradicts the majority.
    """
    units = tuple(mapped.position_units)
    for scale in _SCALES:
        own = _pick(ordered, scale)
        stated = {scale.base, scale.small} & set(units)
        if stated or mapped.side != "joint" or mapped.counts_per_turn or not own:
            continue
        small, largest = [], []
        for file, _, frame, _ in read:
            group = choose_groups(
                file, [str(c) for c in frame.columns], [one.name for one in ordered], mapped
            )
            if group["position"].units:
                return units
            values = frame[[group["position"].columns[k] for k in own]]
            size = values.apply(pd.to_numeric, errors="coerce").dropna().to_numpy(dtype=float)
            small.append(_are_small(file, group["position"], size, [ordered[k] for k in own], scale))
            largest.append(float(np.abs(size).max(initial=0.0)))
        if all(small) or not any(small):
            continue
        worst = int(np.argmax(largest))
        if np.mean(small) <= 0.5 and largest[worst] > scale.farthest:
            raise InputError(
                f"{read[worst][0]}: its positions reach {largest[worst]:.3g}, as {scale.small} do, and those "
                f"of most others do not; give --position-unit {scale.base} or --position-unit {scale.small}, "
                "or leave the file out."
            )
        units = (*units, scale.small if np.mean(small) > 0.5 else scale.base)
    return units


def _pick(ordered: Sequence[Joint], scale: _Scale) -> list[int]:
    """Return the indices of the joints, revolute or prismatic, that a scale is for."""
    return [k for k, joint in enumerate(ordered) if (joint.kind == "prismatic") == scale.slides]


def position_unit(
    file: Path,
    group: Group,
    values: Array,
    ordered: Sequence[Joint],
    mapped: Mapped,
    notes: list[str],
) -> Array:
    """Return the factors (n,) from recorded positions to rad or m; the side of the gear is not changed."""
    counts = take_option("counts-per-turn", mapped.counts_per_turn, len(ordered), "above 0")
    if counts is not None:
        notes.append(f"{file.name}: positions are counts of encoders, as stated.")
        turns = np.array([joint.kind != "prismatic" for joint in ordered])
        return np.where(turns, 2.0 * np.pi, 1.0) / counts.values
    if group.units and not mapped.position_units:
        notes.append(f"{file.name}: positions are in {' and '.join(group.units)}, by their names.")
        return group.factors
    unit, taken = np.ones(len(ordered)), []
    for scale in _SCALES:
        own = _pick(ordered, scale)
        if not own:
            continue
        stated = [one for one in mapped.position_units if one in (scale.base, scale.small)]
        part = values[:, own]
        largest = float(np.abs(part).max(initial=0.0))
        if stated:
            unit[own] = scale.factor if stated[0] == scale.small else 1.0
            if stated[0] == scale.small and mapped.side == "joint" and largest < scale.farthest / 2.0:
                notes.append(
                    f"{file.name}: positions are read as {scale.small}, as stated, though none exceeds "
                    f"{largest:.3g}, which is the size of {scale.base} (else --position-unit {scale.base})."
                )
            continue
        counted = (np.abs(part).max(axis=0, initial=0.0) > _COUNTS) & (part == np.round(part)).all(axis=0)
        if counted.all():
            raise InputError(
                f"{file}: its positions are whole numbers of up to {largest:.6g}, as counts of an encoder "
                "are; give --counts-per-turn (with --side motor those of a motor's turn), or "
                f"--position-unit {scale.small}."
            )
        if counted.any():
            one = own[int(np.argmax(counted))]
            raise InputError(
                f"{file}: column '{group.columns[one]}' alone has whole numbers, as counts of an encoder do; "
                f"give --position-unit {scale.base} and --scale q_{ordered[one].name}=X, X being "
                f"{scale.base} for one count, or --position-unit {scale.small}."
            )
        small = mapped.side == "joint" and _are_small(file, group, part, [ordered[k] for k in own], scale)
        unit[own] = scale.factor if small else 1.0
        taken.append(
            f"{scale.small}, by their size (else --position-unit {scale.base}, or --side motor)"
            if small
            else scale.base
        )
    if taken:
        notes.append(f"{file.name}: positions are taken as {' and '.join(taken)}.")
    return unit


def _are_small(file: Path, group: Group, values: Array, ordered: Sequence[Joint], scale: _Scale) -> bool:
    """Return whether positions (N, n) are, by their magnitude, in the smaller unit (deg or mm)."""
    farthest = np.abs(values).max(axis=0, initial=0.0)
    limits = np.array([max(abs(joint.lower), abs(joint.upper)) for joint in ordered])
    bound = (0.0 < limits) & (limits < OPEN_LIMIT) & [joint.kind != "continuous" for joint in ordered]
    beyond = (farthest > 2.0 * _BEYOND * limits) & (farthest * scale.factor <= _BEYOND * limits)
    # A wheel or turntable may turn as often as it likes, so that the other joints tell the unit.
    counted = farthest[bound] if bound.any() else farthest
    small = counted.max() > scale.farthest or bool(np.any(bound & beyond))
    marks = {word for column in group.columns for word in split_name(column)}
    if small and "motor" in marks and not any("motor" in split_name(joint.name) for joint in ordered):
        raise InputError(
            f"{file}: its positions reach {farthest.max():.3g} and are named as a motor's; give --side motor "
            f"and --gear-ratio, or where they are those of the joint, --position-unit {scale.small}."
        )
    return small


def unwrap_counts(counts: Array) -> Array:
    """Remove the jumps from counts (N, n) of counters that restart at a power of two."""
    reach = np.maximum(np.ptp(counts, axis=0), 1.0)
    period = 2.0 ** np.ceil(np.log2(reach + 1.0))
    return np.column_stack([np.unwrap(one, period=own) for one, own in zip(counts.T, period, strict=True)])


def unwrap_positions(
    numbers: pd.DataFrame, columns: Sequence[str], unit: Array, ordered: Sequence[Joint]
) -> set[str]:
    """Unwrap angles in place; return the joints whose angle jumped by a full turn.

    This comes before any interpolation, which would produce wrong angles across a jump.
    """
    wrapped = set()
    for joint, column, one in zip(ordered, columns, unit, strict=True):
        there = numbers[column].dropna()
        if joint.kind != "prismatic" and len(there):
            turned, jumps = unwrap_turns(there.to_numpy(dtype=float), 2.0 * np.pi / one)
            if jumps:
                numbers[column] = pd.Series(turned, there.index)
                wrapped.add(joint.name)
    return wrapped


def align_turns(
    frames: Sequence[pd.DataFrame], wrapped: Sequence[Joint], side: str, notes: list[str]
) -> None:
    """Shift unwrapped joints by whole turns, and add a note.

    The first recording is shifted into the URDF's limits; the others are shifted next to the first.
    """
    for joint in wrapped if side == "joint" else ():
        column = f"q_{joint.name}"
        middle = 0.5 * (joint.lower + joint.upper)
        for k, frame in enumerate(frames):
            far = 0.5 * (frame[column].min() + frame[column].max()) - middle
            turns = 2.0 * np.pi * np.round(far / (2.0 * np.pi))
            frame[column] -= turns
            middle += far - turns if k == 0 else 0.0
    if wrapped:
        names = ", ".join(joint.name for joint in wrapped)
        turn = "URDF's limits" if side == "joint" else "motor as recorded, which may differ by recording"
        notes.append(f"{names}: unwrapped where a full turn begins again; the turn is that of the {turn}.")


def take_ratios(gear: Figures | None, why: str, n: int) -> Array:
    """Return the gear ratios (n,); `InputError` where they are missing, whose message begins with `why`."""
    if gear is None:
        raise InputError(f"{why}: needs the gear ratios; give --gear-ratio.")
    return gear.values


def read_torque(
    file: Path, group: Group, values: Mapping[str, Array], mapped: Mapped, gear: Figures | None, n: int
) -> tuple[Array, list[str]]:
    """Convert the torque or current columns to torque (N, n) on the joint side [N m or N], with a note."""
    constant = take_option("torque-constant", mapped.torque_constant, n)
    told = ""
    factor = np.ones(n) if constant is None else constant.values
    share = next((one for one in group.units if one in SHARES), "")
    if share and constant is None:
        raise InputError(
            f"{file}: column '{group.columns[0]}' is in {share} of a rated {group.kind}; give "
            f"--torque-constant: N m (N of a slide) for one unit of the column (the rated torque by "
            f"{1000 if share in ('‰', 'permille') else 100}), for each joint."
        )
    if "torque" in values:
        named = group.factors
        if np.any(named != 1.0):
            told = f", in {' and '.join(group.units)} by their names"
        elif group.unknown:
            told = f", in N m (N of a slide), as '{group.unknown}' is no known unit (else --torque-constant)"
        elif not (group.units or np.any(np.mod(values["torque"], 1.0) > 0.0)):
            told = (
                ", in N m (N of a slide); whole numbers may be per mille or counts (then --torque-constant)"
            )
        if constant is not None:
            factor = factor / named  # stated for one unit of the column, whatever unit its name has
            told = ", times --torque-constant"
        if mapped.torque_side == "motor":
            return values["torque"] * factor * take_ratios(gear, "--torque-side motor", n), [
                f"{file.name}: torques at the motor, times the gear ratio{told}."
            ]
        return values["torque"] * factor, [
            f"{file.name}: torques are taken as those at the joint{told} (else --torque-side motor)."
        ]
    if constant is None:
        raise InputError(
            f"{file}: has currents and no torques; give --torque-constant (N m/A at the motor) and "
            "--gear-ratio, or --torque-constant alone where it is N m/A at the joint."
        )
    geared = gear is not None or mapped.torque_side == "motor"
    return values["current"] * factor * (take_ratios(gear, "--torque-side motor", n) if geared else 1.0), [
        f"{file.name}: torques are the currents times --torque-constant"
        f"{' and --gear-ratio' if geared else ''}."
    ]
