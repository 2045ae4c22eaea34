"""Servos: presets of published constants, the option that states a servo, and its columns in a recording."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from wearscope.errors import InputError
from wearscope.robots.servos import COLUMNS, ServoFields, read_servo
from wearscope.robots.spatial import Array
from wearscope.starters.columns import Group, find_groups, match_pattern

#: Constants at the output shaft, by servo. They come from Rhoban/bam (Apache-2.0,
#: ``params/<servo>/m6.json``), where they were fitted to recordings of a pendulum together with the most
#: detailed friction law; with another friction law they would differ. XL330: 885 counts are full duty by the
#: maker's manual. MX-64, MX-106: the largest duty was measured in the same work. STS3215: at 7.4 V; its load
#: column counts 1000 for full duty.
PRESETS: dict[str, dict[str, Any]] = {
    "xl330": {"law": "duty", "kt": 0.304, "resistance": 2.45, "duty_full": 885.0},
    "mx64": {"law": "voltage", "kt": 1.602, "resistance": 2.316, "duty_limit": 0.9625},
    "mx106": {"law": "voltage", "kt": 2.21, "resistance": 2.034, "duty_limit": 0.9625},
    "sts3215": {"law": "duty", "kt": 1.275, "resistance": 2.753, "duty_full": 1000.0},
}
#: Kinds of columns that only servos have.
SERVO_KINDS = ("goal", "duty", "gain", "volts", "on")
#: A supply voltage in whole numbers above this is in tenths of a volt, the unit of these servos' registers.
_TENTHS = 30.0
#: Columns that a law can use and does not need, by law.
_OPTIONAL = {"voltage": ("volts", "on"), "duty": ("goal", "volts", "on"), "current": ("on",)}


def read_servo_option(text: str) -> ServoFields:
    """Read a servo from the text ``PRESET``, ``name=value,...``, or ``PRESET,name=value,...``.

    Raises
    ------
    InputError
        Where a preset or constant is unknown, missing or not a positive number.
    """
    stated: dict[str, Any] = {}
    for part in (one.strip() for one in text.split(",")):
        name, equals, value = (one.strip() for one in part.partition("="))
        if not equals:
            if name not in PRESETS or stated:
                known = ", ".join(PRESETS)
                raise InputError(
                    f"--servo {text}: '{part}' is no servo that is known ({known}) and no name=value; write "
                    "e.g. law=duty,kt=0.3,resistance=2.5,duty_full=885."
                )
            stated |= PRESETS[name]
            continue
        try:
            stated[name] = value if name == "law" else float(value)
        except ValueError:
            raise InputError(
                f"--servo {text}: {name} is '{value}', which is no number; correct it."
            ) from None
    return read_servo("--servo", stated)


def choose_servo_groups(
    file: Path,
    columns: Sequence[str],
    joints: Sequence[str],
    servo: ServoFields,
    patterns: Mapping[str, str],
    movable: Sequence[str] = (),
) -> dict[str, Group]:
    """Choose the columns of a servo's goal, duty, gain, current, supply voltage and on/off switch, by kind.

    Parameters
    ----------
    file : Path
    columns, joints : sequence of str
    servo : ServoFields
    patterns : mapping of str to str
        Columns that the user names, by kind.
    movable : sequence of str
        As for `wearscope.starters.columns.find_groups`.

    Raises
    ------
    InputError
        Where a column that the law needs is not found.
    """
    groups = {}
    # A servo's gain registers have another unit, so a gain column is taken only where the user names it.
    named = ("gain",) if servo.law == "voltage" and "gain" in patterns else ()
    for kind in (*COLUMNS[servo.law], *named, *_OPTIONAL[servo.law]):
        if kind in patterns:
            groups[kind] = match_pattern(patterns[kind], columns, joints, kind, movable)
            continue
        found = find_groups(columns, joints, "position" if kind == "goal" else kind, movable)
        found = [one for one in found if one.is_commanded == (kind == "goal")]
        if found:
            groups[kind] = replace(found[0], kind=kind)
        elif kind in COLUMNS[servo.law]:
            raise InputError(
                f"{file}: servo law {servo.law} needs the {kind} of each of {', '.join(joints)}; name its "
                f"columns with --{kind} 'NAME_*'; the columns are {', '.join(columns[:30])}."
            )
    if servo.law != "current" and "volts" not in groups and servo.volts is None:
        raise InputError(
            f"{file}: has no column of the supply's voltage; name it with --volts 'NAME_*', or add volts=7.4 "
            "to --servo."
        )
    return groups


def read_raw_units(file: Path, values: dict[str, Array], counts: Sequence[float]) -> list[str]:
    """Convert a servo's raw units in place: tenths of a volt, and counts that start at the turn's end.

    Voltages become volts. Counts become counts from the middle of the turn. Returns notes on both.

    Parameters
    ----------
    file : Path
    values : dict of str to ndarray (N, n)
        Values by kind; they are changed.
    counts : sequence of float
        Counts for a turn, for each joint or for all; empty where positions are not counts.
    """
    notes = []
    volts = values.get("volts")
    if volts is not None and np.all(volts == np.round(volts)) and np.median(volts) > _TENTHS:
        values["volts"] = volts / 10.0
        notes.append(f"{file.name}: the supply is read as tenths of a volt, by its size.")
    position = values["position"]
    if len(counts) and np.all((position >= 0.0) & (position < counts)):
        for kind in ("position", "goal"):
            if kind in values:
                values[kind] = values[kind] - np.array(counts) / 2.0
        notes.append(f"{file.name}: counts of a servo's turn are taken from its middle (else --shift).")
    return notes
