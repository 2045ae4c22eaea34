"""What the user states about recordings, and the choice of their columns, sample rate and use.

Columns that the user names are taken; otherwise they are found by their names. All recordings get one sample
rate: those that a model is fitted to and those that only test it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from wearscope.errors import InputError
from wearscope.robots.servos import ServoFields
from wearscope.starters.columns import KINDS, Group, find_groups, match_pattern, name_joints
from wearscope.starters.servos import choose_servo_groups

#: Effects that a new data set declares where the user names none.
DECLARED = ("rigid_body", "rotor_inertia", "coulomb", "viscous")


@dataclass(frozen=True)
class Mapped:
    """What the user states about the recordings.

    Attributes
    ----------
    joints : sequence of str
        Joints in the recordings; empty for all movable joints of the URDF.
    movable : sequence of str
        All movable joints of the URDF; the columns may be numbered over them.
    patterns : mapping of str to str
        Columns by kind, with ``*`` for the joint.
    time, time_unit, topic : str or None
        Column of the time and its unit; topic of the joint states in a bag. None leaves the choice open.
    rate : float or None
        Sample rate [Hz]; None takes it from the clock.
    position_units : sequence of str
        ``rad`` or ``deg`` for revolute joints, ``m`` or ``mm`` for prismatic joints.
    counts_per_turn : sequence of float
        Encoder counts for a turn, or for a metre of a prismatic joint.
    side, torque_side : str
        ``joint`` or ``motor``: on which side of the gear positions, and torques, are measured.
    gear_ratio, torque_constant : sequence of float
        Motor turns for a joint turn; torque [N m] for an ampere, or for one unit of the torque columns.
    declared, accept, test : sequence of str
        Declared effects; names of refusals to overrule; recordings that only test the model.
    inertials : str
        How far the inertial parameters of the URDF are trusted, as in `dataset.yaml`.
    payload : float or None
        [kg]
    payload_com : sequence of float
        Its centre of mass in the frame of the last joint's link [m].
    servo : ServoFields or None
        Servo whose law gives the torque.
    turned : sequence of str
        Columns of the data set whose sign is reversed.
    shifted : mapping of str to float
        Value added to a position, by column of the data set [rad or m].
    scaled : mapping of str to float
        Factor on a position and its speed, by the position's column of the data set.
    readings : mapping of str to str
        Meaning of the torque column, by joint, as `torque` in dataset.yaml states it; the empty name is for
        all joints.
    gravity : sequence of float
        Gravity in the base frame [m/s^2]; empty for a robot that stands upright.
    sessions : mapping of str to str
        Label of a recording's session, by file name.
    reference : sequence of str
        Sessions in which the machine was healthy. Where these are given, a recording without a label is a
        session named after its file.
    payloads : mapping of str to sequence of float
        Mass [kg] and centre of mass [m] of a recording's payload, by file name.
    torque_gain : mapping of str to float
        Factor on the torque, by joint.
    time_scale : float or None
        True time over recorded time.
    columns : sequence of str
        Names of the columns, for files without names.
    """

    joints: Sequence[str] = ()
    movable: Sequence[str] = ()
    patterns: Mapping[str, str] = field(default_factory=dict)
    time: str | None = None
    time_unit: str | None = None
    topic: str | None = None
    rate: float | None = None
    position_units: Sequence[str] = ()
    counts_per_turn: Sequence[float] = ()
    side: str = "joint"
    torque_side: str = "joint"
    gear_ratio: Sequence[float] = ()
    torque_constant: Sequence[float] = ()
    declared: Sequence[str] = DECLARED
    accept: Sequence[str] = ()
    test: Sequence[str] = ()
    inertials: str = "approximate"
    payload: float | None = None
    payload_com: Sequence[float] = (0.0, 0.0, 0.0)
    servo: ServoFields | None = None
    turned: Sequence[str] = ()
    shifted: Mapping[str, float] = field(default_factory=dict)
    scaled: Mapping[str, float] = field(default_factory=dict)
    readings: Mapping[str, str] = field(default_factory=dict)
    gravity: Sequence[float] = ()
    sessions: Mapping[str, str] = field(default_factory=dict)
    payloads: Mapping[str, Sequence[float]] = field(default_factory=dict)
    reference: Sequence[str] = ()
    torque_gain: Mapping[str, float] = field(default_factory=dict)
    time_scale: float | None = None
    columns: Sequence[str] = ()


#: Value of an option, such as ``--velocity``, by which a user excludes all columns of a kind of signal.
NONE = "none"


def choose_groups(
    file: Path, columns: Sequence[str], joints: Sequence[str], mapped: Mapped
) -> dict[str, Group]:
    """Choose the columns of a recording, by kind.

    Positions are needed, and torques or currents, or what a servo's law needs. Speeds and temperatures are
    taken where they exist.

    Raises
    ------
    InputError
        Where there are no positions, or no columns that tell the torque.
    """
    groups: dict[str, Group] = {}
    for kind in KINDS:
        if mapped.patterns.get(kind) == NONE:
            continue
        if kind in mapped.patterns:
            groups[kind] = match_pattern(mapped.patterns[kind], columns, joints, kind, mapped.movable)
            continue
        found = find_groups(columns, joints, kind, mapped.movable)
        if found and not (kind != "position" and found[0].is_commanded):
            groups[kind] = found[0]
    told = f"the columns are {', '.join(columns[:30])}"
    if "position" not in groups:
        # A file whose columns name several joints is not the file of one.
        several = len(joints) == 1 or len(name_joints(columns, joints)) > 1
        if not several and find_groups(columns, joints[:1], "position"):
            raise InputError(
                f"{file}: has the columns of one joint, and the URDF moves {', '.join(joints)}; put joints "
                f"that move together side by side in one file, as q_{joints[0]}, q_{joints[1]}, or give "
                f"--joints with the one that this file is of; {told}."
            )
        raise InputError(
            f"{file}: no column of positions is found for each of {', '.join(joints)}; name them with "
            f"--position 'NAME_*' or a list, or fewer joints with --joints; {told}."
        )
    if mapped.servo is not None:
        groups.pop("torque", None)
        groups.pop("current", None)
        return groups | choose_servo_groups(
            file, columns, joints, mapped.servo, mapped.patterns, mapped.movable
        )
    if mapped.patterns.get("current", NONE) != NONE:
        groups.pop("torque", None)
    if "torque" in groups:
        groups.pop("current", None)
    elif "current" not in groups:
        raise InputError(
            f"{file}: no column of torques or currents is found for each of {', '.join(joints)}; name "
            f"them with --torque 'NAME_*' or --current 'NAME_*'; {told}."
        )
    return groups


def describe_groups(groups: Mapping[str, Group]) -> list[str]:
    """Return a note on the columns of each kind."""
    return [
        f"{kind}: {group.columns[0]}"
        + (f" to {group.columns[-1]}" if len(group.columns) > 1 else "")
        + (", commanded ones, as none is measured." if group.is_commanded else ".")
        for kind, group in groups.items()
    ]


#: Recordings whose rates differ by less than this share count as equally fast; the data set's reader
#: resamples them.
_OFF = 0.15
#: A single recording is cut in two: the share of its motion that trains, and the gap before the test part
#: [s].
_TRAINING, _GAP = 0.7, 1.0
#: Least length of each part [s]; time step over which the motion is summed [s].
_PART, _STEP = 2.0, 0.1


@dataclass
class Recorded:
    """A recording in the platform's columns: ``t``, and ``q_<joint>``, ``tau_<joint>`` and other signals."""

    name: str
    frame: pd.DataFrame
    use: str = "train"
    file: str = ""


def take_common_rate(
    runs: list[Recorded], rates: Sequence[float], files: Sequence[Path], stated: float | None
) -> tuple[float, list[str]]:
    """Choose one sample rate [Hz] for all recordings, average faster ones to it, and return it with notes.

    Raises
    ------
    InputError
        Where a recording is slower than the stated rate.
    """
    slow = [own for own in rates if own < (1.0 + _OFF) * min(rates)]
    rate, notes = stated or float(np.median(slow)), []
    for k, (file, own) in enumerate(zip(files, rates, strict=True)):
        if own < (1.0 - _OFF) * rate:
            raise InputError(
                f"{file}: has {own:g} Hz where --rate says {rate:g} Hz; give --rate {own:g}, or leave it out."
            )
        if own > (1.0 + _OFF) * rate:
            frame = runs[k].frame
            part = np.floor((frame["t"] - frame["t"].iloc[0] + 0.5 / own) * rate)
            runs[k] = replace(runs[k], frame=frame.groupby(part.to_numpy()).mean().reset_index(drop=True))
            notes.append(f"{file.name}: {own:g} Hz, averaged to {rate:g} Hz.")
    return rate, notes


def _find_cut(frame: pd.DataFrame, rate: float) -> int:
    """Return the row before which the joints have done the share `_TRAINING` of their motion."""
    every = max(1, round(_STEP * rate))
    q = frame[[name for name in frame if str(name).startswith("q_")]].to_numpy(dtype=float)[::every]
    moved = np.abs(np.diff(q, axis=0)) / np.maximum(np.ptp(q, axis=0), 1e-12)
    done = np.cumsum(moved.mean(axis=1)) if len(q) > 1 else np.ones(1)
    return every * (int(np.searchsorted(done, _TRAINING * done[-1])) + 1)


def choose_uses(runs: list[Recorded], files: Sequence[Path], test: Sequence[str], rate: float) -> list[str]:
    """Mark the runs that only test the model; a single run is cut in two. Returns a note."""
    if len(runs) == 1:
        if test:
            raise InputError("--test: there is one recording only; give another for training.")
        whole = runs[0]
        cut = _find_cut(whole.frame, rate)
        later = whole.frame.iloc[cut + int(_GAP * rate) :]
        if min(cut, len(later)) < _PART * rate:
            raise InputError(
                f"{files[0]}: {len(whole.frame) / rate:.3g} s are too short to be cut into a training and "
                f"a test part; record {2.0 * _PART / (1.0 - _TRAINING):.0f} s or more, or give a "
                "second recording."
            )
        runs[:] = [
            replace(whole, name=f"{whole.name}_first", frame=whole.frame.iloc[:cut]),
            replace(whole, name=f"{whole.name}_last", frame=later, use="test"),
        ]
        return [
            f"test: the one recording's last {len(later) / rate:.0f} s, {100 * (1 - _TRAINING):.0f} % of its "
            "motion; a second one would say more."
        ]
    chosen = {Path(one).name for one in test} or {files[-1].name}
    unknown = chosen - {file.name for file in files} - {run.file for run in runs}
    if unknown:
        raise InputError(f"--test {sorted(unknown)[0]}: is none of the recordings; name one of them.")
    for run, file in zip(runs, files, strict=True):
        run.use = "test" if chosen & {file.name, run.file} else "train"
    if all(run.use == "test" for run in runs):
        raise InputError("--test: names every recording; leave one for training.")
    return [f"test: {', '.join(sorted(chosen))}" + ("." if test else ", the last one, as none was named.")]
