"""Reads a measured data set from its folder, and refuses one that breaks the format.

This module checks fields, columns, rows and rates against each other. What the signals say about units,
torque side and signs is checked in `wearscope.closed_loop.intake.plausibility`. Every recording is read once
for these checks and not kept; `RunRecord.load` reads it again when it is needed.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from wearscope.closed_loop.intake.acceptance import Acceptance
from wearscope.closed_loop.intake.clock import check_clock, split_at_gaps
from wearscope.closed_loop.intake.data_folder import digest_dataset, find_inside
from wearscope.closed_loop.intake.dataset_fields import (
    DatasetFields,
    PayloadFields,
    RunFields,
    UnitFields,
    load_fields,
    read_fields,
)
from wearscope.closed_loop.intake.field_checks import check_fields
from wearscope.closed_loop.intake.recording import Run, estimate_quantum
from wearscope.closed_loop.intake.repeats import Signature, find_copies, sign_run
from wearscope.closed_loop.intake.servo import merge_notes, take_torques
from wearscope.closed_loop.intake.table_files import read_columns, take_column, take_given, take_positions
from wearscope.errors import InputError
from wearscope.storage.files import check_plain

#: Lowest and highest believable temperature of a machine [deg C].
_COLDEST, _HOTTEST = -60.0, 250.0


@dataclass(frozen=True, eq=False)
class RunRecord:
    """A recording that has been checked; its arrays are in its file.

    Attributes
    ----------
    file, use : str
    payload : PayloadFields or None
    session : str or None
    reach, quantum : ndarray (n,)
        Span of each joint's position and step of its encoder [rad or m]; a step of 0 is unknown.
    load : callable
        Reads the recording as one `Run`, not split at its gaps.
    recorded : tuple of (float, float)
        Start and end of each piece between gaps [s since the first row].
    stretches : tuple of (float, float) or None
        Start and end of each part that is used [s since the first row]; all of it where None.
    """

    file: str
    use: str
    payload: PayloadFields | None
    session: str | None
    reach: np.ndarray
    quantum: np.ndarray
    load: Callable[[], Run]
    recorded: tuple[tuple[float, float], ...] = ()
    stretches: tuple[tuple[float, float], ...] | None = None

    @property
    def seconds(self) -> float:
        """Recorded time [s], without gaps."""
        return sum(stop - start for start, stop in self.recorded)


@dataclass
class Dataset:
    """A measured data set as read.

    Attributes
    ----------
    folder : Path
    fields : DatasetFields
    runs : list of RunRecord
        In the order of the file.
    position_unit, torque_unit : list of str
        By joint.
    accepted : Acceptance
        Refusals by inference that the data set overrules.
    notes : list of str
        Remarks for the reader; none of them refuses the data.
    digest : str
        SHA-256 of its files, see `digest_dataset`.
    delays : tuple of float
        Time [s] by which each torque channel was moved, as its declared delay; empty where none was.
    """

    folder: Path
    fields: DatasetFields
    runs: list[RunRecord]
    position_unit: list[str]
    torque_unit: list[str]
    accepted: Acceptance = field(default_factory=Acceptance)
    notes: list[str] = field(default_factory=list)
    digest: str = ""
    delays: tuple[float, ...] = ()

    @property
    def name(self) -> str:
        """Name of the data set."""
        return self.fields.name

    @property
    def joints(self) -> list[str]:
        """Joint names, in the order of all columns."""
        return self.fields.robot.joints

    @property
    def urdf(self) -> Path:
        """Path of the robot's URDF."""
        return self.folder / self.fields.robot.urdf

    def runs_for(self, use: str) -> list[RunRecord]:
        """Runs of one use, in the order of the file."""
        return [run for run in self.runs if run.use == use]


def _read_run(folder: Path, entry: RunFields, fields: DatasetFields) -> Run:
    """Recording in joint order, with the signs, factors and zeros that `dataset.yaml` states."""
    path, joints = folder / entry.file, fields.robot.joints
    frame = read_columns(path)
    t = fields.time_scale * take_column(path, frame, "t")
    told = check_clock(str(path), t, fields.sample_rate)
    uncounted = [fields.readings()[joint] == "none" for joint in joints]
    named = {f"tau_{joint}" for joint, one in zip(joints, uncounted, strict=True) if one}
    frame = frame.assign(**dict.fromkeys(named - set(frame.columns), 0.0))
    q = take_positions(path, frame, joints)
    torque = take_torques(path, frame, joints, fields.servos, t, q)
    torque.off[:, uncounted] = True
    speed = take_given(path, frame, "qd", joints)
    way = {
        kind: np.array([-1.0 if f"{kind}_{joint}" in fields.turned else 1.0 for joint in joints])
        for kind in ("q", "tau")
    }
    way["q"] = way["q"] * [fields.scaled.get(f"q_{joint}", 1.0) for joint in joints]
    way["tau"] = way["tau"] * [fields.torque_gain.get(joint, 1.0) for joint in joints]
    zero = np.array([fields.shifted.get(f"q_{joint}", 0.0) for joint in joints])
    return Run(
        entry.file,
        entry.use,
        t - t[0],
        q * way["q"] + zero,
        torque.tau * way["tau"],
        None if speed is None else speed * way["q"],
        take_given(path, frame, "temp", joints),
        entry.payload,
        session=entry.session,
        channels={name: take_column(path, frame, name) for name in fields.channels},
        start=float(t[0]),
        quantum=estimate_quantum(q) * np.abs(way["q"]),
        off=torque.off if torque.off.any() else None,
        notes=(*(f"{path.name}: {one}" for one in told), *torque.notes),
    )


def _check_run(path: Path, run: Run, fields: DatasetFields) -> None:
    """Refuse temperatures that no machine has, and torques that are constant though the joint moves."""
    t = run.temperature
    if t is not None and (np.nanmin(t) < _COLDEST or np.nanmax(t) > _HOTTEST):
        raise InputError(f"{path}: a temperature lies outside -60..250 deg C; give deg C.")
    reach = np.ptp(run.q, axis=0)
    for i, (joint, reading) in enumerate(fields.readings().items()):
        if reading != "none" and np.ptp(run.tau[:, i]) == 0.0 and reach[i] > max(1e-3 * reach.max(), 1e-9):
            raise InputError(
                f"{path}: column 'tau_{joint}' is constant ({run.tau[0, i]:g}); the channel is dead or "
                "saturated, or the joint has no drive; record it again or leave the joint out."
            )


def list_run_problems(folder: Path, fields: DatasetFields) -> list[str]:
    """One sentence for each recording that is wrong by itself."""
    found = []
    for entry in fields.runs:
        try:
            find_inside(folder, entry.file, f"{folder / 'dataset.yaml'}: runs[].file")
            run = _read_run(folder, entry, fields)
            _check_run(folder / entry.file, run, fields)
            split_at_gaps(run, fields.sample_rate, str(folder / run.file))
        except InputError as error:
            found.append(str(error))
    return found


def _read_records(
    folder: Path, fields: DatasetFields, notes: list[str]
) -> tuple[list[RunRecord], list[Signature]]:
    """Read and check the recordings one at a time; keep a signature of each, and add notes."""
    records, signatures = [], []
    told: list[str] = []
    for entry in fields.runs:
        run = _read_run(folder, entry, fields)
        told += run.notes
        _check_run(folder / entry.file, run, fields)
        pieces, _ = split_at_gaps(run, fields.sample_rate, str(folder / run.file))
        recorded = tuple((float(piece.t[0]), float(piece.t[-1])) for piece in pieces)
        signatures.append(sign_run(run, fields.sample_rate))
        load = partial(_read_run, folder, entry, fields)
        reach = np.ptp(run.q, axis=0)
        quantum = np.zeros(len(reach)) if run.quantum is None else run.quantum
        records.append(RunRecord(run.file, run.use, run.payload, run.session, reach, quantum, load, recorded))
    notes += merge_notes(told)
    _check_torques(folder, signatures, fields)
    return records, signatures


def _check_torques(folder: Path, signatures: list[Signature], fields: DatasetFields) -> None:
    """Refuse a torque that is constant in every train run although its joint moves in one of them."""
    train = [s.spread for s, entry in zip(signatures, fields.runs, strict=True) if entry.use == "train"]
    largest = np.max(train, axis=0)
    readings = fields.readings()
    moves = largest[len(readings) :] > 1e-9  # beyond rounding
    for i, (joint, reading) in enumerate(readings.items()):
        if reading != "none" and largest[i] == 0.0 and moves[i]:
            raise InputError(
                f"{folder}: column 'tau_{joint}' is constant in every train run; the channel is dead, record "
                "it again or leave the joint out."
            )


def _check_repeats(
    path: Path, runs: list[RunRecord], signatures: list[Signature], accepted: Acceptance
) -> list[str]:
    """Refuse a run that repeats another run: test runs must have been recorded separately."""
    notes: list[str] = []
    settled = [False] * len(runs)

    def matters(i: int, k: int) -> bool:
        return "train" in (runs[i].use, runs[k].use) and not (settled[i] or settled[k])

    while (pair := find_copies(signatures, matters, lambda i: runs[i].load())) is not None:
        other, run = (runs[i] for i in pair)
        again, first = (run, other) if run.use == "test" or other.use == "train" else (other, run)
        told = (
            f"the {again.use} run {again.file} repeats the {first.use} run {first.file}; give a run that was "
            "recorded apart."
        )
        notes.append(accepted.refuse(str(path), told, f"copy {again.file}"))
        settled[runs.index(again)] = True
    return notes


def _by_joint(path: Path, name: str, stated: Any, count: int) -> list[str]:
    if isinstance(stated, str):
        return [stated] * count
    if len(stated) != count:
        raise InputError(
            f"{path}: units.{name} has {len(stated)} values for {count} joints; give one a joint."
        )
    return list(stated)


def _check_units(path: Path, fields: DatasetFields, prismatic: list[bool]) -> tuple[list[str], list[str]]:
    units = fields.units or UnitFields()
    joints = fields.robot.joints
    stated = zip(
        joints,
        prismatic,
        _by_joint(path, "q", units.q, len(joints)),
        _by_joint(path, "tau", units.tau, len(joints)),
        strict=True,
    )
    mixed = any(prismatic) and not all(prismatic)
    for joint, slides, q, tau in stated:
        fit = ("m", "N") if slides else ("rad", "N m")
        if (q, tau) == fit or (mixed and isinstance(units.q, str) and isinstance(units.tau, str)):
            continue
        kind = "prismatic" if slides else "revolute"
        raise InputError(
            f"{path}: units say q: {q}, tau: {tau}, but joint '{joint}' is {kind}; "
            f"convert the columns to {fit[0]} and {fit[1]} and say so."
        )
    return ["m" if s else "rad" for s in prismatic], ["N" if s else "N m" for s in prismatic]


def read_dataset(
    folder: str | Path, prismatic: Any, choose: Callable[[DatasetFields], list[RunFields]] | None = None
) -> Dataset:
    """Read a data-set folder.

    Parameters
    ----------
    folder : path-like
        Folder with a ``dataset.yaml``.
    prismatic : callable
        Called with the URDF's path and the joint names; says of each joint whether it is prismatic, and
        refuses joints that the URDF does not have.
    choose : callable, optional
        ``choose(fields)`` gives the runs to read, at least one of use ``train``; all where None.

    Raises
    ------
    InputError
        Where the folder breaks the format; the sentence names the file, the field or the row.
    """
    folder = Path(folder)
    path = folder / "dataset.yaml"
    notes: list[str] = []
    fields = read_fields(path, notes)
    accepted, told = check_fields(path, fields)
    if choose is not None:
        fields = fields.model_copy(update={"runs": choose(fields)})
    urdf = find_inside(folder, fields.robot.urdf, f"{path}: robot.urdf")
    check_plain(urdf, np.inf, "correct robot.urdf in dataset.yaml")
    if set(fields.readings().values()) == {"without_gravity"}:
        robot = fields.robot.model_copy(update={"gravity": [0.0, 0.0, 0.0]})
        fields = fields.model_copy(update={"robot": robot})
        notes.append("the torques have no gravity in them, as 'torque' says: the model has none either.")
    if fields.time_scale != 1.0:
        notes.append(f"times are {fields.time_scale:g} times those recorded, as 'time_scale' says.")
    if fields.torque_gain:
        gains = ", ".join(f"tau_{joint} times {by:g}" for joint, by in fields.torque_gain.items())
        notes.append(f"{gains}, as 'torque_gain' says.")
    units = _check_units(path, fields, prismatic(urdf, fields.robot.joints))
    runs, signatures = _read_records(folder, fields, notes)
    notes += told + _check_repeats(path, runs, signatures, accepted)
    digest = digest_dataset(folder, load_fields(path))
    return Dataset(folder, fields, runs, *units, accepted, notes, digest)
