"""Recordings as they come, in the platform's columns: names, units, sides and clocks guessed and said."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope.errors import InputError
from wearscope.robots.spatial import Array
from wearscope.robots.urdf import movable_joints
from wearscope.robots.urdf_file import OPEN_LIMIT, Joint, parse_urdf
from wearscope.servos import ServoFields
from wearscope.starters.columns import (
    KINDS,
    Group,
    find_groups,
    find_time,
    is_commanded,
    match_pattern,
    name_joints,
)
from wearscope.starters.figures import Figures, take_option
from wearscope.starters.recordings import open_recordings
from wearscope.starters.servos import choose_servo_groups
from wearscope.starters.stamps import find_rate, order_rows, to_seconds

#: Positions are in degrees where they go so far [rad], or so far beyond the URDF's limits, as radians.
_FARTHEST, _BEYOND = 4.0 * np.pi, 1.2
#: Rates of two recordings may differ by this share: the reader brings them to one.
_OFF = 0.15
#: Share of a lone recording that is kept for training; a second of it then lies between training and test.
_TRAINING, _GAP = 0.7, 1.0
DECLARED = ("rigid_body", "rotor_inertia", "coulomb", "viscous")


@dataclass(frozen=True)
class Mapped:
    """What the user says of the recordings.

    Attributes
    ----------
    joints : sequence of str
        All that the URDF moves where empty.
    patterns : mapping of str to str
        By kind: columns, with ``*`` for the joint.
    time, time_unit, topic : str or None
    rate : float or None
        [Hz]; from the clock where left out.
    position_unit : str or None
        ``rad``, ``deg``, ``m`` or ``mm``.
    side, torque_side : str
        ``joint`` or ``motor``: where positions, and torques, are measured.
    gear_ratio, torque_constant : sequence of float
        Motor turns per joint turn; N m/A of the motor, at its shaft.
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
    reading : str or None
        What the torques are, as `torque` in dataset.yaml has it.
    sessions : mapping of str to str
        Label of a recording's session, by file name.
    payloads : mapping of str to sequence of float
        Mass [kg] and centre of mass [m] of a recording's payload, by file name.
    """

    joints: Sequence[str] = ()
    patterns: Mapping[str, str] = field(default_factory=dict)
    time: str | None = None
    time_unit: str | None = None
    topic: str | None = None
    rate: float | None = None
    position_unit: str | None = None
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
    reading: str | None = None
    sessions: Mapping[str, str] = field(default_factory=dict)
    payloads: Mapping[str, Sequence[float]] = field(default_factory=dict)


@dataclass
class Recorded:
    """A recording in the platform's columns: ``t``, then by joint ``q_``, ``tau_`` and what else there is."""

    name: str
    frame: pd.DataFrame
    use: str = "train"
    file: str = ""


@dataclass
class Converted:
    """A data set to be written.

    Attributes
    ----------
    joints : list of str
    prismatic : list of bool
    rate : float
        [Hz]
    runs : list of Recorded
    notes : list of str
        What was guessed.
    """

    joints: list[str]
    prismatic: list[bool]
    rate: float
    runs: list[Recorded]
    notes: list[str]


def convert_recordings(files: Sequence[Path], urdf: Path, mapped: Mapped) -> Converted:
    """Read recordings and bring them to the platform's columns.

    Parameters
    ----------
    files : sequence of Path
        See `wearscope.starters.recordings.read_recording`.
    urdf : Path
    mapped : Mapped

    Raises
    ------
    InputError
        Where something cannot be read, found or guessed; the sentence names the option that says it.
    """
    tree = parse_urdf(urdf)
    joints = list(mapped.joints) or movable_joints(tree)
    known = {joint.name: joint for joint in tree.joints}
    for name in joints:
        if name not in known:
            raise InputError(
                f"{urdf}: has no joint '{name}'; its movable joints are {', '.join(movable_joints(tree))}."
            )
    ordered = [known[name] for name in joints]
    prismatic = [joint.kind == "prismatic" for joint in ordered]
    notes: list[str] = []
    runs: list[Recorded] = []
    rates: list[float] = []
    opened: list[Path] = []
    read = list(open_recordings(files, mapped.topic, mapped.servo is not None))
    if not mapped.joints and "position" not in mapped.patterns:
        _propose_joints(urdf, joints, read)
    mapped = replace(mapped, position_unit=_choose_unit(read, ordered, mapped))
    for file, frame, told in read:
        opened.append(file)
        run, rate = _convert(file, frame, ordered, mapped, told)
        _note(notes, told, file.name)
        rates.append(rate)
        runs.append(Recorded(_name_run(file, runs), run, file=file.name))
    rate = _common_rate(rates, opened, mapped.rate)
    notes.append(f"sample rate: {rate:g} Hz, " + ("as stated." if mapped.rate else "from the clock."))
    notes += _choose_uses(runs, opened, mapped.test, rate)
    return Converted(joints, prismatic, rate, runs, notes)


def _propose_joints(
    urdf: Path, joints: Sequence[str], read: Sequence[tuple[Path, pd.DataFrame, Any]]
) -> None:
    """Refuse a URDF with more joints than the columns, with those that the columns have."""
    file, frame, _ = read[0]
    columns = [str(column) for column in frame.columns]
    named = name_joints(columns, joints)
    if named and len(named) < len(joints) and not find_groups(columns, joints, "position"):
        raise InputError(
            f"{file}: has positions of {', '.join(named)}, and {urdf.name} moves {len(joints)} joints; give "
            f"--joints {','.join(named)}."
        )


def _choose_unit(
    read: Sequence[tuple[Path, pd.DataFrame, Any]], ordered: Sequence[Joint], mapped: Mapped
) -> str | None:
    """Unit of the positions of all recordings, where their size tells it of some: a recorder has one unit."""
    turning = [k for k, joint in enumerate(ordered) if joint.kind != "prismatic"]
    if mapped.position_unit is not None or mapped.side != "joint" or not turning:
        return mapped.position_unit
    degrees, largest = [], []
    for file, frame, _ in read:
        group = _choose_groups(file, [str(c) for c in frame.columns], [one.name for one in ordered], mapped)
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


def _note(notes: list[str], told: Sequence[str], file: str) -> None:
    """Add notes; what is the same for every file is said once."""
    for one in told:
        general = one.removeprefix(f"{file}: ")
        if general not in notes and one not in notes:
            notes.append(general if one != general and not one.startswith("row") else one)


def _name_run(file: Path, runs: Sequence[Recorded]) -> str:
    stem = "".join(one if one.isalnum() or one in "_-." else "_" for one in file.stem).strip("._") or "run"
    taken = {run.name for run in runs}
    return next(
        name for k in range(len(runs) + 1) if (name := stem if k == 0 else f"{stem}_{k + 1}") not in taken
    )


def _convert(
    file: Path, frame: pd.DataFrame, ordered: Sequence[Joint], mapped: Mapped, notes: list[str]
) -> tuple[pd.DataFrame, float]:
    """Recording in the platform's columns, and its rate; notes on what was guessed are added."""
    joints = [joint.name for joint in ordered]
    groups = _choose_groups(file, [str(c) for c in frame.columns], joints, mapped)
    t, rows = _read_time(file, frame, mapped, notes)
    used = [column for group in groups.values() for column in group.columns]
    table = frame.iloc[rows].reset_index(drop=True)
    numbers = table[used].apply(pd.to_numeric, errors="coerce")
    whole = numbers.notna().all(axis=1).to_numpy()
    worst = str(numbers.isna().sum().idxmax())
    if not whole.any():
        raise InputError(
            f"{file}: column '{worst}' has no number in any row that is whole; name another column."
        )
    if whole.sum() < 2:
        raise InputError(
            f"{file}: one row alone is whole, of {len(whole)} (column '{worst}' has no number in "
            f"{int(numbers[worst].isna().sum())}), and a recording has many; record it again, or name "
            "another column."
        )
    if not whole.all():
        notes.append(
            f"{file.name}: {int((~whole).sum())} of {len(whole)} rows are not whole and are left out."
        )
    t, numbers = t[whole] - t[whole][0], numbers[whole]
    columns: dict[str, Array] = {"t": t}
    values = {kind: numbers[list(group.columns)].to_numpy(dtype=float) for kind, group in groups.items()}
    gear = take_option("gear-ratio", mapped.gear_ratio, len(joints), -np.inf)
    unit = _position_unit(file, groups["position"], values["position"], ordered, mapped, notes)
    ratio = _ratios(gear, "--side motor", len(joints)) if mapped.side == "motor" else np.ones(len(joints))
    speed = unit if "velocity" not in groups or not groups["velocity"].unit else groups["velocity"].factor
    for kind, prefix, factor in (("position", "q", unit / ratio), ("velocity", "qd", speed / ratio)):
        if kind in values:
            columns |= {
                f"{prefix}_{name}": one for name, one in zip(joints, (values[kind] * factor).T, strict=True)
            }
    values |= {kind: values[kind] * groups[kind].factor for kind in ("torque", "current") if kind in values}
    if "goal" in values:
        values["goal"] = values["goal"] * unit / ratio
    if mapped.servo is None:
        values["tau"], told = _read_torque(file, values, mapped, gear, len(joints))
        notes += told
        kinds: tuple[str, ...] = ("tau",)
    else:
        kinds = tuple(kind for kind in ("goal", "duty", "current", "volts", "on") if kind in values)
    for k, joint in enumerate(joints):
        columns |= {f"{kind}_{joint}": values[kind][:, k] for kind in kinds}
        if "temperature" in values:
            columns[f"temp_{joint}"] = values["temperature"][:, k]
    notes += [f"{file.name}: {line}" for line in _describe(groups)]
    return pd.DataFrame(columns), find_rate(t)


def _describe(groups: Mapping[str, Group]) -> list[str]:
    return [
        f"{kind}: {group.columns[0]}" + (f" to {group.columns[-1]}" if len(group.columns) > 1 else "") + "."
        for kind, group in groups.items()
    ]


def _choose_groups(
    file: Path, columns: Sequence[str], joints: Sequence[str], mapped: Mapped
) -> dict[str, Group]:
    groups: dict[str, Group] = {}
    for kind in KINDS:
        if kind in mapped.patterns:
            groups[kind] = match_pattern(mapped.patterns[kind], columns, joints, kind)
            continue
        found = find_groups(columns, joints, kind)
        if found and not (kind != "position" and is_commanded(found[0])):
            groups[kind] = found[0]
    told = f"the columns are {', '.join(columns[:30])}"
    if "position" not in groups:
        raise InputError(
            f"{file}: no column of positions is found for each of {', '.join(joints)}; name them with "
            f"--position 'NAME_*', or fewer joints with --joints; {told}."
        )
    if mapped.servo is not None:
        groups.pop("torque", None)
        groups.pop("current", None)
        return groups | choose_servo_groups(file, columns, joints, mapped.servo, mapped.patterns)
    if "current" in mapped.patterns:
        groups.pop("torque", None)
    if "torque" in groups:
        groups.pop("current", None)
    elif "current" not in groups:
        raise InputError(
            f"{file}: no column of torques or currents is found for each of {', '.join(joints)}; name "
            f"them with --torque 'NAME_*' or --current 'NAME_*'; {told}."
        )
    return groups


def _read_time(file: Path, frame: pd.DataFrame, mapped: Mapped, notes: list[str]) -> tuple[Array, np.ndarray]:
    """Times [s] and the rows that they belong to."""
    if mapped.time is not None and mapped.time not in frame.columns:
        raise InputError(f"{file}: has no column '{mapped.time}'; correct --time.")
    names = (mapped.time,) if mapped.time else find_time([str(c) for c in frame.columns])
    if not names:
        if mapped.rate is None:
            raise InputError(f"{file}: no column of time is found; name it with --time, or give --rate.")
        notes.append(f"{file.name}: no time; rows are taken as {mapped.rate:g} Hz.")
        return np.arange(len(frame)) / mapped.rate, np.arange(len(frame))
    where = f"{file}: column '{names[0]}'"
    if len(names) == 2:
        stamps = frame[names[0]].astype("int64") * 1_000_000_000 + frame[names[1]].astype("int64")
        t, told = to_seconds(stamps, where, "ns")
    else:
        t, told = to_seconds(frame[names[0]], where, mapped.time_unit)
    rows, kept, more = order_rows(t, where)
    notes += [one.replace(str(file), file.name) for one in [*told, *more]]
    if len(rows) < 2:
        raise InputError(f"{where}: has fewer than two rows with a time; record the run again.")
    return kept, rows


def _position_unit(
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


def _ratios(gear: Figures | None, why: str, n: int) -> Array:
    if gear is None:
        raise InputError(f"{why}: needs the gear ratios; give --gear-ratio.")
    if np.any(gear.values == 0.0):
        raise InputError("--gear-ratio holds a 0; give motor turns per joint turn.")
    return gear.values


def _read_torque(
    file: Path, values: Mapping[str, Array], mapped: Mapped, gear: Figures | None, n: int
) -> tuple[Array, list[str]]:
    """Torque (N, n) on the joint side."""
    if "torque" in values:
        if mapped.torque_side == "motor":
            return values["torque"] * _ratios(gear, "--torque-side motor", n), [
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
    ratio = np.ones(n) if gear is None else _ratios(gear, "--current", n)
    told = "times --torque-constant" + ("" if gear is None else " and --gear-ratio")
    return values["current"] * constant.values * ratio, [f"{file.name}: torques are the currents {told}."]


def _common_rate(rates: Sequence[float], files: Sequence[Path], stated: float | None) -> float:
    rate = stated or float(np.median(rates))
    for file, own in zip(files, rates, strict=True):
        if abs(own / rate - 1.0) > _OFF:
            raise InputError(
                f"{file}: has {own:g} Hz where {'--rate says' if stated else 'others have'} {rate:g} Hz; "
                "a data set has one rate, so make one data set for each."
            )
    return rate


def _choose_uses(runs: list[Recorded], files: Sequence[Path], test: Sequence[str], rate: float) -> list[str]:
    """Mark the runs that are only scored; a lone run is cut in two."""
    if len(runs) == 1:
        if test:
            raise InputError("--test: there is one recording only; give another for training.")
        whole = runs[0]
        cut = int(_TRAINING * len(whole.frame))
        later = whole.frame.iloc[cut + int(_GAP * rate) :]
        if len(later) < 2 * rate:
            raise InputError(
                f"{files[0]}: is too short to be cut into a training and a test part; give a second one."
            )
        runs[:] = [
            replace(whole, name=f"{whole.name}_first", frame=whole.frame.iloc[:cut]),
            replace(whole, name=f"{whole.name}_last", frame=later, use="test"),
        ]
        return [
            f"test: the last {100 * (1 - _TRAINING):.0f} % of the one recording; a second one would say more."
        ]
    chosen = {Path(one).name for one in test} or {files[-1].name}
    unknown = chosen - {file.name for file in files}
    if unknown:
        raise InputError(f"--test {sorted(unknown)[0]}: is none of the recordings; name one of them.")
    for run, file in zip(runs, files, strict=True):
        run.use = "test" if file.name in chosen else "train"
    if all(run.use == "test" for run in runs):
        raise InputError("--test: names every recording; leave one for training.")
    return [f"test: {', '.join(sorted(chosen))}" + ("." if test else ", the last one, as none was named.")]
