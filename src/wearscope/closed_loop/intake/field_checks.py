"""Whether the fields of `dataset.yaml` fit each other: list lengths, names, effects, columns, paths, uses."""

import difflib
import math
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

from wearscope import limits, plugins
from wearscope.closed_loop.intake.acceptance import Acceptance
from wearscope.closed_loop.intake.data_folder import find_inside
from wearscope.closed_loop.intake.dataset_fields import DatasetFields, RobotFields
from wearscope.errors import InputError
from wearscope.robots.servos import read_servos

#: Strongest gravity on Earth is 9.83 m/s^2; a field beyond this is in another unit.
_STRONGEST = 15.0


def check_fields(path: Path, fields: DatasetFields) -> tuple[Acceptance, list[str]]:
    """Refuse fields that do not fit each other.

    Returns
    -------
    Acceptance
        What the data set accepts.
    list of str
        Notes.

    Raises
    ------
    InputError
    """
    for check in _list_checks(path, fields):
        check()
    accepted = Acceptance.read(
        str(path), fields.accept, fields.robot.joints, [run.file for run in fields.runs]
    )
    strength = math.hypot(*fields.robot.gravity)
    notes = []
    if strength > _STRONGEST:
        told = f"robot.gravity is {strength:.4g} m/s^2 strong, which it is nowhere on Earth; give m/s^2."
        notes.append(accepted.refuse(str(path), told, "size gravity"))
    return accepted, notes


def list_conflicts(path: Path, fields: DatasetFields) -> list[str]:
    """One sentence for each fault that `check_fields` refuses."""
    found = []
    checks = _list_checks(path, fields)
    checks.append(partial(check_fields, path, fields))
    for check in checks:
        try:
            check()
        except InputError as error:
            found.append(str(error))
    return list(dict.fromkeys(found))


def _list_checks(path: Path, fields: DatasetFields) -> list[Callable[[], object]]:
    return [
        partial(_check_by_joint, path, fields.robot),
        partial(_check_effects, path, fields),
        partial(_check_channels, path, fields),
        partial(_check_columns, path, fields),
        partial(_check_runs, path, fields),
        partial(read_servos, str(path), fields.servo, fields.robot.joints),
    ]


def _check_by_joint(path: Path, robot: RobotFields) -> None:
    joints = robot.joints
    if len(set(joints)) < len(joints):
        raise InputError(f"{path}: robot.joints names a joint twice; name each once.")
    for name in ("torque_limit", "gear_ratio", "rotor_inertia"):
        values = getattr(robot, name)
        if values is not None and len(values) != len(joints):
            raise InputError(
                f"{path}: robot.{name} has {len(values)} values for {len(joints)} joints; give one a joint."
            )
    if robot.rotor_inertia is not None and min(robot.rotor_inertia) < 0:
        raise InputError(f"{path}: robot.rotor_inertia holds a negative value; give kg m^2 at the joint.")
    if robot.torque_limit is not None and min(robot.torque_limit) <= 0:
        raise InputError(f"{path}: robot.torque_limit must be positive; give the limit of each joint.")
    for name, most in limits.DRIVE.items():
        if max(map(abs, getattr(robot, name) or [0.0])) > most:
            raise InputError(
                f"{path}: robot.{name} holds a value above {most:g}, which no joint has; correct it."
            )
    if robot.gear_ratio is not None and 0.0 in robot.gear_ratio:
        raise InputError(f"{path}: robot.gear_ratio holds a 0; give motor turns by joint turn.")


def _check_effects(path: Path, fields: DatasetFields) -> None:
    """Check that effects are known and own effect files lie in the folder; no file is run."""
    installed = plugins.list_installed("effects")
    for reference in fields.effects:
        if not reference.endswith(".py") and reference not in installed:
            raise InputError(
                f"{path}: effects: '{reference}' is no path of a .py file; name the files of own effects."
            )
    known = [name for name in plugins.list_names("effects", "EFFECT") if name != "unknown"] + installed
    for name in [name for name in fields.effects + fields.declared_effects if name.endswith(".py")]:
        if not find_inside(path.parent, name, f"{path}: effects").is_file():
            raise InputError(f"{path.parent / name}: no such file; correct effects in dataset.yaml.")
    for name in fields.declared_effects:
        if name not in known and not name.endswith(".py"):
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean '{near[0]}'?" if near else f"; choose from {', '.join(known)}."
            raise InputError(f"{path}: declared_effects: there is no effect '{name}'{hint}")
    if len(set(fields.declared_effects)) < len(fields.declared_effects):
        raise InputError(f"{path}: declared_effects names an effect twice; name each once.")


def _check_channels(path: Path, fields: DatasetFields) -> None:
    joints = fields.robot.joints
    taken = {"t", *(f"{kind}_{joint}" for kind in ("q", "qd", "tau", "temp") for joint in joints)}
    for name in fields.channels:
        if name in taken:
            raise InputError(
                f"{path}: channels: '{name}' is a column that the format already gives a meaning; name "
                "only further columns."
            )


def _check_columns(path: Path, fields: DatasetFields) -> None:
    """Check the fields that name columns or joints: `torque`, `turned`, `shifted`, `scaled`, and so on."""
    joints = fields.robot.joints
    for joint in fields.torque if isinstance(fields.torque, dict) else ():
        if joint not in joints:
            raise InputError(f"{path}: torque: there is no joint '{joint}'; choose from {', '.join(joints)}.")
    if set(fields.readings().values()) == {"none"}:
        raise InputError(f"{path}: torque is 'none' at every joint; leave it out where the torque counts.")
    columns = [f"{kind}_{joint}" for kind in ("q", "tau") for joint in joints]
    for column in fields.turned:
        if column not in columns:
            raise InputError(f"{path}: turned: '{column}' is none of {', '.join(columns)}; name one of them.")
    told = ", ".join(columns[: len(joints)])
    for field, stated in (("shifted", fields.shifted), ("scaled", fields.scaled)):
        for column in stated:
            if column not in columns[: len(joints)]:
                raise InputError(f"{path}: {field}: '{column}' is none of {told}; name one of them.")
    if 0.0 in fields.scaled.values():
        raise InputError(f"{path}: scaled: holds a 0; give what the positions are multiplied with.")
    for joint, factor in fields.torque_gain.items():
        if joint not in joints or factor == 0.0:
            raise InputError(
                f"{path}: torque_gain: '{joint}: {factor:g}' is no factor of one of {', '.join(joints)}; "
                "correct it."
            )
    for joint in fields.robot.locked:
        if joint in joints:
            raise InputError(
                f"{path}: robot.locked: joint '{joint}' is one of robot.joints; leave it out of one of them."
            )


def _check_runs(path: Path, fields: DatasetFields) -> None:
    files = [run.file for run in fields.runs]
    times = Counter(files)
    for file in files:
        find_inside(path.parent, file, f"{path}: runs[].file")
        if times[file] > 1:
            raise InputError(f"{path}: runs names {file} more than once; a run is either train or test.")
    for use in ("train", "test"):
        if not any(run.use == use for run in fields.runs):
            raise InputError(f"{path}: no run has 'use: {use}'; give at least one.")
    sessions = {run.session for run in fields.runs}
    for session in fields.reference:
        if session not in sessions:
            raise InputError(
                f"{path}: reference: no run has 'session: {session}'; name sessions that the runs state."
            )
