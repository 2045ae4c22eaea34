"""Converts recordings of any form to the platform's columns; it may guess names, units and clocks."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope.errors import InputError
from wearscope.robots.spatial import Array
from wearscope.robots.urdf import Joint, free_joints, movable_joints, parse_urdf
from wearscope.starters.columns import count_numbered, find_groups, guess_positions, name_joints
from wearscope.starters.figures import take_option
from wearscope.starters.held import take_news
from wearscope.starters.mapped import (
    Mapped,
    Recorded,
    choose_groups,
    choose_uses,
    describe_groups,
    take_common_rate,
)
from wearscope.starters.recordings import open_recordings
from wearscope.starters.servos import read_raw_units
from wearscope.starters.stamps import find_clock, find_rate, find_restarts, order_rows, to_seconds
from wearscope.starters.text_files import find_odd
from wearscope.starters.units import (
    align_turns,
    choose_units,
    position_unit,
    read_torque,
    take_ratios,
    unwrap_counts,
    unwrap_positions,
)

#: Recorded position from which on a joint that is locked at 0 is told, in the column's unit.
_AWAY = 0.02


@dataclass
class Converted:
    """Converted recordings, ready to be written as a data set.

    Attributes
    ----------
    joints : list of str
    prismatic : list of bool
        Whether each joint is prismatic.
    rate : float
        Sample rate [Hz].
    runs : list of Recorded
    notes : list of str
        What was guessed, in sentences for the user.
    columns : dict of str to tuple of str
        Columns of the last recording, by kind of signal, in the order of the joints.
    """

    joints: list[str]
    prismatic: list[bool]
    rate: float
    runs: list[Recorded]
    notes: list[str]
    columns: dict[str, tuple[str, ...]]


def convert_recordings(files: Sequence[Path], urdf: Path, mapped: Mapped) -> Converted:
    """Read recordings and convert them to the platform's columns.

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
    mapped = replace(mapped, movable=movable_joints(tree))
    joints, notes = (list(mapped.joints), []) if mapped.joints else free_joints(tree)
    known = {joint.name: joint for joint in tree.joints}
    for name in joints:
        if name not in known:
            raise InputError(
                f"{urdf}: has no joint '{name}'; its movable joints are {', '.join(movable_joints(tree))}."
            )
    if len(set(joints)) < len(joints):
        raise InputError(f"{urdf}: --joints names a joint twice; name each once.")
    runs: list[Recorded] = []
    rates: list[float] = []
    stated = mapped.rate
    opened: list[Path] = []
    opening = open_recordings(files, mapped.topic, mapped.servo is not None, mapped.columns)
    read = _split_restarts(opening, mapped)
    if not mapped.joints and "position" not in mapped.patterns:
        joints = _choose_joints(urdf, joints, read, notes)
    notes += _tell_left_out(joints, mapped.movable, read)
    ordered = [known[name] for name in joints]
    prismatic = [joint.kind == "prismatic" for joint in ordered]
    mapped = replace(mapped, position_units=choose_units(read, ordered, mapped))
    wrapped: set[str] = set()
    for file, part, frame, told in read:
        opened.append(part)
        run, rate, slower, wraps, own = _convert(part, frame, ordered, mapped, told)
        wrapped |= wraps
        stated = None if slower else stated
        _note(notes, told, part.name)
        rates.append(rate)
        runs.append(Recorded(_name_run(part, runs), run, file=file.name))
    turned = [joint for joint in ordered if joint.name in wrapped]
    align_turns([run.frame for run in runs], turned, mapped.side, notes)
    rate, told = take_common_rate(runs, rates, opened, stated)
    notes += [f"sample rate: {rate:g} Hz, " + ("as stated." if stated else "from the clock."), *told]
    notes += choose_uses(runs, opened, mapped.test, rate)
    return Converted(joints, prismatic, rate, runs, notes, own)


def _split_restarts(
    read: Iterable[tuple[Path, pd.DataFrame, list[str]]], mapped: Mapped
) -> list[tuple[Path, Path, pd.DataFrame, list[str]]]:
    """Split each file where its clock restarts; return file, name, table and notes of each recording."""
    parts = []
    for file, frame, told in read:
        names = (mapped.time,) if mapped.time else find_clock(frame)
        starts = find_restarts(frame[names[0]]) if names and names[0] in frame else []
        if not starts:
            parts.append((file, file, frame, told))
            continue
        told = [
            f"{file.name}: its clock restarts, so that it is taken as {len(starts) + 1} recordings.",
            *told,
        ]
        for k, (first, end) in enumerate(pairwise([0, *starts, len(frame)])):
            part = file.with_stem(f"{file.stem}-{k + 1}")
            parts.append((file, part, frame.iloc[first:end].reset_index(drop=True), list(told)))
    return parts


def _choose_joints(
    urdf: Path,
    joints: Sequence[str],
    read: Sequence[tuple[Path, Path, pd.DataFrame, Any]],
    notes: list[str],
) -> list[str]:
    """Return the joints that have columns; joints of a hand behind them are left out, with a note.

    Raises
    ------
    InputError
        Where joints without columns are not behind those that have columns.
    """
    file, _, frame, _ = read[0]
    columns = [str(column) for column in frame.columns]
    if find_groups(columns, joints, "position"):
        return list(joints)
    named, numbered = name_joints(columns, joints), count_numbered(columns)
    if named and len(named) < len(joints):
        told, given = f"positions of {', '.join(named)}", named
    elif not named and 1 < numbered < len(joints):
        told, given = f"{numbered} numbered positions", list(joints[:numbered])
    else:
        return list(joints)
    rest = [joint for joint in joints if joint not in given]
    if set(rest) <= _list_behind(urdf, given[-1]) and find_groups(columns, given, "position"):
        notes.append(
            f"{', '.join(rest)}: left out, as a hand behind {given[-1]} that has no columns; locked at 0."
        )
        return given
    remedy = f"give --joints {','.join(given)}."
    if named and (guessed := guess_positions(columns, joints)):
        told += f", and none that name {', '.join(rest)}"
        remedy = f"give --position '{','.join(guessed)}' if these are theirs; else {remedy}"
    raise InputError(f"{file}: has {told}, and {urdf.name} moves {', '.join(joints)}; {remedy}")


def _tell_left_out(
    joints: Sequence[str], movable: Sequence[str], read: Sequence[tuple[Path, Path, pd.DataFrame, Any]]
) -> list[str]:
    """Return a note on each joint that is locked at 0 although its recorded position is another one."""
    notes = {}
    for joint, (_, part, frame, _) in product(movable, read):
        with_it = [one for one in movable if one == joint or one in joints]
        groups = find_groups([str(one) for one in frame], with_it, "position", movable)
        if joint in joints or joint in notes or not groups:
            continue
        column = groups[0].columns[with_it.index(joint)]
        x = pd.to_numeric(frame[column], errors="coerce")
        if x.abs().max() > _AWAY:
            notes[joint] = (
                f"{joint}: locked at 0, but column '{column}' goes from {x.min():.4g} to {x.max():.4g} in "
                f"{part.name}; the torques hold what this changes. Record the joint at rest, and write its "
                f'position [rad or m] as "locked: {{{joint}: ...}}" below robot in dataset.yaml.'
            )
    return list(notes.values())


def _list_behind(urdf: Path, joint: str) -> set[str]:
    """Return the joints that a given joint carries, directly or through others."""
    found: set[str] = set()
    tree = {one.name: one for one in parse_urdf(urdf).joints}
    links = {tree[joint].child}
    while more := {name for name, one in tree.items() if one.parent in links} - found:
        found |= more
        links |= {tree[name].child for name in more}
    return found


def _note(notes: list[str], told: Sequence[str], file: str) -> None:
    """Add notes; a note that is the same for every file is added once, without the file's name."""
    for one in told:
        general = one.removeprefix(f"{file}: ")
        if general not in notes and one not in notes:
            notes.append(general if one != general and not one.startswith("row") else one)


def _name_run(file: Path, runs: Sequence[Recorded]) -> str:
    """Name a run after its file, with a number where another run has that name."""
    stem = "".join(one if one.isalnum() or one in "_-." else "_" for one in file.stem).strip("._") or "run"
    taken = {run.name for run in runs}
    return next(
        name for k in range(len(runs) + 1) if (name := stem if k == 0 else f"{stem}_{k + 1}") not in taken
    )


def _convert(
    file: Path, frame: pd.DataFrame, ordered: Sequence[Joint], mapped: Mapped, notes: list[str]
) -> tuple[pd.DataFrame, float, bool, set[str], dict[str, tuple[str, ...]]]:
    """Convert one recording to the platform's columns, and add what was guessed to the notes.

    Returns the table, its sample rate [Hz], whether the rate is that of a slower column whose values repeat
    over rows, the joints whose angle began again after a full turn, and the recording's columns by kind.
    """
    joints = [joint.name for joint in ordered]
    groups = choose_groups(file, [str(c) for c in frame.columns], joints, mapped)
    t, rows = _read_time(file, frame, mapped, notes)
    used = [column for group in groups.values() for column in dict.fromkeys(group.columns)]
    again = [column for column in dict.fromkeys(used) if used.count(column) > 1]
    if again:
        raise InputError(f"{file}: column '{again[0]}' is taken for two things; name others by options.")
    table = frame.iloc[rows].reset_index(drop=True)
    numbers = table[used].apply(pd.to_numeric, errors="coerce")
    for column in used:
        if len(odd := find_odd(table[column], numbers[column])):
            raise InputError(
                f"{file}: column '{column}' has cells that are no numbers, such as '{odd.iloc[0][:40]}'; "
                "write plain numbers with one decimal mark, or name another column."
            )
    positions = list(groups["position"].columns)
    unit = position_unit(
        file,
        groups["position"],
        numbers[positions].ffill().bfill().dropna().to_numpy(dtype=float),
        ordered,
        mapped,
        notes,
    )
    wrapped = set() if mapped.counts_per_turn else unwrap_positions(numbers, positions, unit, ordered)
    own = {kind: group.columns for kind, group in groups.items()}
    t, numbers, held = take_news(t, numbers, own, file.name)
    notes += held
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
    gear = take_option("gear-ratio", mapped.gear_ratio, len(joints), "other than 0")
    ratio = take_ratios(gear, "--side motor", len(joints)) if mapped.side == "motor" else np.ones(len(joints))
    speed = groups["velocity"].factors if "velocity" in groups and groups["velocity"].units else unit
    if mapped.servo is not None:
        notes += read_raw_units(file, values, mapped.counts_per_turn)
    if mapped.counts_per_turn:
        values |= {kind: unwrap_counts(values[kind]) for kind in ("position", "goal") if kind in values}
    for kind, prefix, factor in (("position", "q", unit / ratio), ("velocity", "qd", speed / ratio)):
        if kind in values:
            columns |= {
                f"{prefix}_{name}": one for name, one in zip(joints, (values[kind] * factor).T, strict=True)
            }
    values |= {kind: values[kind] * groups[kind].factors for kind in ("torque", "current") if kind in values}
    if "goal" in values:
        values["goal"] = values["goal"] * unit / ratio
    if mapped.servo is None:
        driven = groups["torque" if "torque" in groups else "current"]
        values["tau"], told = read_torque(file, driven, values, mapped, gear, len(joints))
        notes += told
        kinds: tuple[str, ...] = ("tau",)
    else:
        kinds = tuple(kind for kind in ("goal", "duty", "gain", "current", "volts", "on") if kind in values)
    for k, joint in enumerate(joints):
        columns |= {f"{kind}_{joint}": values[kind][:, k] for kind in kinds}
        if "temperature" in values:
            columns[f"temp_{joint}"] = values["temperature"][:, k]
    notes += [f"{file.name}: {line}" for line in describe_groups(groups)]
    return pd.DataFrame(columns), find_rate(t), bool(held), wrapped, own


def _read_time(file: Path, frame: pd.DataFrame, mapped: Mapped, notes: list[str]) -> tuple[Array, np.ndarray]:
    """Return the times (N,) [s], and the indices (N,) of the rows that they belong to."""
    if mapped.time is not None and mapped.time not in frame.columns:
        raise InputError(f"{file}: has no column '{mapped.time}'; correct --time.")
    names = (mapped.time,) if mapped.time else find_clock(frame)
    if not names:
        if mapped.rate is None:
            raise InputError(f"{file}: no column of time is found; name it with --time, or give --rate.")
        notes.append(f"{file.name}: no time; rows are taken as {mapped.rate:g} Hz.")
        return np.arange(len(frame)) / mapped.rate, np.arange(len(frame))
    where = f"{file}: column '{names[0]}'"
    if len(names) == 2:
        seconds, rest = (pd.to_numeric(frame[name], errors="coerce") for name in names)
        t, told = to_seconds((seconds - seconds.min()) * 1e9 + rest, where, "ns")
    else:
        t, told = to_seconds(frame[names[0]], where, mapped.time_unit, names[0])
    rows, kept, more = order_rows(t, where)
    notes += [one.replace(str(file), file.name) for one in [*told, *more]]
    if len(rows) < 2:
        raise InputError(f"{where}: has fewer than two rows with a time; record the run again.")
    return kept, rows
