"""What the user says of recordings, and which of their columns and rows are taken.

Columns that the user names are taken, else those that are found. All recordings are brought to one rate,
those that are fitted and those that are only scored.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from wearscope.errors import InputError
from wearscope.robots.servos import ServoFields
from wearscope.starters.columns import KINDS, Group, find_groups, is_commanded, match_pattern
from wearscope.starters.servos import choose_servo_groups

DECLARED = ("rigid_body", "rotor_inertia", "coulomb", "viscous")


@dataclass(frozen=True)
class Mapped:
    """What the user says of the recordings.

    Attributes
    ----------
    joints : sequence of str
        All that the URDF moves where empty.
    movable : sequence of str
        All that the URDF moves: columns may be numbered by them.
    patterns : mapping of str to str
        By kind: columns, with ``*`` for the joint.
    time, time_unit, topic : str or None
    rate : float or None
        [Hz]; from the clock where left out.
    position_units : sequence of str
        ``rad`` or ``deg`` of joints that turn, ``m`` or ``mm`` of those that slide.
    counts_per_turn : sequence of float
        Counts of the encoders in a turn, or in a metre where a joint slides.
    side, torque_side : str
        ``joint`` or ``motor``: where positions, and torques, are measured.
    gear_ratio, torque_constant : sequence of float
        Motor turns per joint turn; N m by ampere, or by unit of the torque columns.
    declared, accept, test : sequence of str
        Effects; refusals that are overruled; recordings that are only scored.
    inertials : str
    payload : float or None
        [kg]
    payload_com : sequence of float
        Its centre of mass in the frame of the last joint's link [m].
    servo : ServoFields or None
        Whose law gives the torque.
    turned : sequence of str
        Columns of the data set that are turned round.
    shifted : mapping of str to float
        What is added to positions of the data set, by column [rad or m].
    scaled : mapping of str to float
        What positions and speeds of the data set are multiplied with, by the position's column.
    readings : mapping of str to str
        What the torques are, by joint, as `torque` in dataset.yaml has it; under an empty name for all.
    gravity : sequence of float
        In the base frame [m/s^2]; of a robot that stands upright where empty.
    sessions : mapping of str to str
        Label of a recording's session, by file name.
    reference : sequence of str
        Sessions in which the machine was healthy. With them a recording without a label is a session of its
        name.
    payloads : mapping of str to sequence of float
        Mass [kg] and centre of mass [m] of a recording's payload, by file name.
    torque_gain : mapping of str to float
        What torques are multiplied with, by joint.
    time_scale : float or None
        True time over the recorded one.
    columns : sequence of str
        Names of the columns of files that have none.
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


#: Pattern of a kind whose columns are left out.
NONE = "none"


def choose_groups(
    file: Path, columns: Sequence[str], joints: Sequence[str], mapped: Mapped
) -> dict[str, Group]:
    """Columns by kind: position, and torque or current, or what a servo's law needs; others where they are.

    Raises
    ------
    InputError
        Where there are no positions, or nothing that tells the torque.
    """
    groups: dict[str, Group] = {}
    for kind in KINDS:
        if mapped.patterns.get(kind) == NONE:
            continue
        if kind in mapped.patterns:
            groups[kind] = match_pattern(mapped.patterns[kind], columns, joints, kind, mapped.movable)
            continue
        found = find_groups(columns, joints, kind, mapped.movable)
        if found and not (kind != "position" and is_commanded(found[0])):
            groups[kind] = found[0]
    told = f"the columns are {', '.join(columns[:30])}"
    if "position" not in groups:
        if len(joints) > 1 and find_groups(columns, joints[:1], "position"):
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
    """A note on the columns of each kind."""
    return [
        f"{kind}: {group.columns[0]}"
        + (f" to {group.columns[-1]}" if len(group.columns) > 1 else "")
        + (", commanded ones, as none is measured." if is_commanded(group) else ".")
        for kind, group in groups.items()
    ]


#: Recordings whose rates differ by less than this share have one rate; the data set's reader resamples them.
_OFF = 0.15
#: Share of a lone recording's motion that trains, and the gap between it and the test part [s].
_TRAINING, _GAP = 0.7, 1.0
#: Least length of a part [s]; steps in which its motion is added up [s].
_PART, _STEP = 2.0, 0.1


@dataclass
class Recorded:
    """A recording in the platform's columns: ``t``, then by joint ``q_``, ``tau_`` and what else there is."""

    name: str
    frame: pd.DataFrame
    use: str = "train"
    file: str = ""


def take_common_rate(
    runs: list[Recorded], rates: Sequence[float], files: Sequence[Path], stated: float | None
) -> tuple[float, list[str]]:
    """Rate of all recordings [Hz], to which faster ones are averaged, with notes.

    Raises
    ------
    InputError
        Naming a recording that is slower than the stated rate.
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
    """Row that divides the motion of all joints by share, so that they move before and after it."""
    every = max(1, round(_STEP * rate))
    q = frame[[name for name in frame if str(name).startswith("q_")]].to_numpy(dtype=float)[::every]
    moved = np.abs(np.diff(q, axis=0)) / np.maximum(np.ptp(q, axis=0), 1e-12)
    done = np.cumsum(moved.mean(axis=1)) if len(q) > 1 else np.ones(1)
    return every * (int(np.searchsorted(done, _TRAINING * done[-1])) + 1)


def choose_uses(runs: list[Recorded], files: Sequence[Path], test: Sequence[str], rate: float) -> list[str]:
    """Mark the runs that are only scored; a lone run is cut in two."""
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
