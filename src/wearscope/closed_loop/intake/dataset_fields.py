"""The fields of `dataset.yaml`, read and checked against each other."""

import difflib
import math
import re
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from wearscope import limits, plugins
from wearscope.closed_loop.intake.acceptance import Acceptance
from wearscope.closed_loop.intake.data_folder import find_inside, read_text
from wearscope.errors import InputError, explain_yaml
from wearscope.plain_yaml import load_plain_yaml, take_label
from wearscope.servos import ServoFields, read_servos, refuse_bool

#: Strongest gravity on Earth is 9.83 m/s^2; a field beyond this is in another unit.
_STRONGEST = 15.0


def _refuse_huge(value: float) -> float:
    if abs(value) > limits.NUMBER:
        raise ValueError(f"should be below {limits.NUMBER:g} in size")
    return value


_Number = Annotated[
    float, BeforeValidator(refuse_bool), Field(allow_inf_nan=False), AfterValidator(_refuse_huge)
]


_Label = Annotated[str, BeforeValidator(take_label)]
_Distance = Annotated[_Number, Field(ge=-limits.LENGTH, le=limits.LENGTH)]
_Names = Annotated[list[str], Field(max_length=limits.ENTRIES)]
_PositionUnit = Literal["rad", "m"]
_TorqueUnit = Literal["N m", "N"]


TorqueReading = Literal["motor", "link", "without_gravity", "none"]


class _Fields(BaseModel):
    model_config = ConfigDict(extra="allow", coerce_numbers_to_str=True)


class PayloadFields(_Fields):
    """`runs[].payload`."""

    mass: _Number = Field(ge=0.0, le=limits.MASS)
    com: list[_Distance] = Field(default=[0.0, 0.0, 0.0], min_length=3, max_length=3)


class RunFields(_Fields):
    """`runs[]`."""

    file: str
    use: Literal["train", "test"]
    payload: PayloadFields | None = None
    session: _Label | None = None


class RobotFields(_Fields):
    """`robot`."""

    urdf: str
    joints: list[str] = Field(min_length=1, max_length=limits.JOINTS)
    inertials: Literal["trusted", "approximate"] = "trusted"
    gravity: list[_Number] = Field(default=[0.0, 0.0, -9.81], min_length=3, max_length=3)
    torque_limit: list[_Number] | None = None
    gear_ratio: list[_Number] | None = None
    rotor_inertia: list[_Number] | None = None
    locked: dict[str, _Number] = {}


class UnitFields(_Fields):
    """`units`: one for all joints, or a list by joint where a robot both turns and slides."""

    q: _PositionUnit | list[_PositionUnit] = "rad"
    tau: _TorqueUnit | list[_TorqueUnit] = "N m"


class DatasetFields(_Fields):
    """`dataset.yaml`."""

    name: _Label = Field(min_length=1)
    description: str = ""
    source: str = ""
    robot: RobotFields
    sample_rate: _Number = Field(gt=0.0)
    units: UnitFields | None = None
    declared_effects: _Names
    effects: _Names = []
    channels: dict[str, str] = {}
    servo: dict[str, Any] | None = None
    accept: _Names = []
    torque: TorqueReading | dict[str, TorqueReading] = "motor"
    turned: _Names = []
    shifted: dict[str, _Number] = {}
    reference: list[_Label] = []
    runs: list[RunFields] = Field(min_length=1, max_length=limits.RUNS)

    def readings(self) -> dict[str, TorqueReading]:
        """What each joint's torque column is."""
        if isinstance(self.torque, dict):
            return {joint: self.torque.get(joint, "motor") for joint in self.robot.joints}
        return dict.fromkeys(self.robot.joints, self.torque)

    @property
    def servos(self) -> dict[str, ServoFields]:
        """Servo of each joint that has one."""
        return read_servos("dataset.yaml", self.servo, self.robot.joints)


def folder_name(name: Any, where: str) -> str:
    """Name of the results' folder of a data set: its name with '-' for spaces.

    Raises
    ------
    InputError
        Where the name is missing, holds other than letters, digits, '_', '-', '.' and inner spaces, is too
        long, or consists of dots only.
    """
    name = take_label(name)
    if isinstance(name, int | float) and not isinstance(name, bool):
        name = str(name)
    plain = isinstance(name, str) and re.fullmatch(r"[\w.-]+( +[\w.-]+)*", name) is not None
    if not plain or not name.strip(". ") or len(name) > limits.NAME:
        raise InputError(
            f"{where}: name is missing or holds other than letters, digits, '_', '-', '.' and inner "
            f"spaces, or more than {limits.NAME} characters; the results' folder is called like it, "
            "so correct it."
        )
    return re.sub(" +", "-", name)


def _refuse_typos(fields: BaseModel, where: str, notes: list[str]) -> None:
    known = list(type(fields).model_fields)
    for key in fields.model_extra or {}:
        near = difflib.get_close_matches(str(key), known, n=1, cutoff=0.75)
        if near:
            raise InputError(f"{where}: there is no field '{key}'; did you mean '{near[0]}'?")
        notes.append(f"{where}: field '{key}' is not known and was not used.")


def list_breaches(path: Path) -> list[str]:
    """Every field of a `dataset.yaml` that is wrong by itself, a sentence each.

    Raises
    ------
    InputError
        Where the file cannot be read.
    """
    content = load_yaml(path)
    if not isinstance(content, dict):
        return [f"{path}: holds no fields; write them as 'field: value'."]
    try:
        DatasetFields.model_validate(content)
    except ValidationError as error:
        found: dict[tuple[str, ...], str] = {}
        for one in error.errors():
            # Of a field that may be of two kinds, what is wrong as the first of them.
            place = tuple(str(part) for part in one["loc"] if "[" not in str(part))
            found.setdefault(place, str(_explain(path, content, one)))
        return list(dict.fromkeys(found.values()))
    except (RecursionError, ValueError, OverflowError) as error:
        return [f"{path}: holds a value that cannot be read ({str(error)[:100]})."]
    return []


def _explain(path: Path, content: dict, first: Any) -> InputError:
    """Sentence about a field that is wrong; a misspelt name of it is looked for at its place."""
    parts = [p for p in first["loc"] if isinstance(p, int) or p.isidentifier()]
    place = ""
    siblings: Any = content
    for k, part in enumerate(parts):
        place += f"[{part}]" if isinstance(part, int) else f".{part}" if place else str(part)
        if isinstance(siblings, dict) and part not in siblings:
            near = difflib.get_close_matches(str(part), [str(key) for key in siblings], n=1, cutoff=0.7)
            if near and k == len(parts) - 1:
                where = f"{path}: {place.rpartition('.')[0]}".rstrip(": ")
                return InputError(f"{where}: there is no field '{near[0]}'; did you mean '{part}'?")
            break
        try:
            siblings = siblings[part]
        except (KeyError, IndexError, TypeError):
            break
    told = first["msg"].removeprefix("Value error, ").replace("Input should", "should")
    if first["type"] == "missing":
        told = "is missing"
    elif first["type"] in ("model_type", "dict_type"):
        told = f"should hold fields of its own, as 'name: value', but is {str(first['input'])[:40]!r}"
    elif first["type"] not in ("too_short", "too_long"):
        told += f", but is {str(first['input'])[:40]!r}"
    return InputError(
        f"{path}: field '{place}' {told[0].lower()}{told[1:]}; correct it as docs/measured-data.md says."
    )


def load_yaml(path: Path) -> Any:
    """Content of a `dataset.yaml`, of plain values only.

    Raises
    ------
    InputError
        Where there is no such file, or it is no YAML.
    """
    remedy = "a data set is a folder with a dataset.yaml in it"
    if (other := path.with_suffix(".yml")).is_file():
        remedy = f"rename {other.name} to {path.name}"
    text = read_text(path, remedy)
    try:
        return load_plain_yaml(text)
    except yaml.YAMLError as error:
        raise InputError(
            f"{path}: not readable as YAML ({explain_yaml(error)}); correct that line."
        ) from error


def load_fields(path: Path) -> dict[Any, Any]:
    """Fields of a `dataset.yaml` as they are written.

    Raises
    ------
    InputError
        As `load_yaml`, or where it holds no fields.
    """
    content = load_yaml(path)
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds no fields; write them as 'field: value'.")
    return content


def read_fields(path: Path, notes: list[str]) -> DatasetFields:
    """Read `dataset.yaml`; fields that are not known are noted, misspelt ones refused.

    Raises
    ------
    InputError
    """
    content = load_fields(path)
    try:
        fields = DatasetFields.model_validate(content)
    except ValidationError as error:
        raise _explain(path, content, error.errors()[0]) from error
    except (RecursionError, ValueError, OverflowError) as error:
        raise InputError(f"{path}: holds a value that cannot be read ({str(error)[:100]}).") from error
    folder_name(fields.name, str(path))
    _refuse_typos(fields, str(path), notes)
    _refuse_typos(fields.robot, f"{path}: robot", notes)
    for i, run in enumerate(fields.runs):
        _refuse_typos(run, f"{path}: runs[{i}]", notes)
        if run.payload is not None:
            _refuse_typos(run.payload, f"{path}: runs[{i}].payload", notes)
    if fields.units is not None:
        _refuse_typos(fields.units, f"{path}: units", notes)
    return fields


def check_fields(path: Path, fields: DatasetFields) -> tuple[Acceptance, list[str]]:
    """Refuse fields that do not fit each other: list lengths, names, effects, paths, uses.

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
    files = [run.file for run in fields.runs]
    _check_by_joint(path, fields.robot)
    _check_effects(path, fields)
    _check_channels(path, fields)
    _check_runs(path, fields)
    read_servos(str(path), fields.servo, fields.robot.joints)
    accepted = Acceptance.read(str(path), fields.accept, fields.robot.joints, files)
    strength = math.hypot(*fields.robot.gravity)
    notes = []
    if strength > _STRONGEST:
        told = f"robot.gravity is {strength:.4g} m/s^2 strong, which it is nowhere on Earth; give m/s^2."
        notes.append(accepted.refuse(str(path), told, "size gravity"))
    return accepted, notes


def list_conflicts(path: Path, fields: DatasetFields) -> list[str]:
    """Everything that `check_fields` refuses, a sentence each."""
    checks: list[Callable[[], object]] = [
        partial(_check_by_joint, path, fields.robot),
        partial(_check_effects, path, fields),
        partial(_check_channels, path, fields),
        partial(_check_columns, path, fields),
        partial(_check_runs, path, fields),
        partial(read_servos, str(path), fields.servo, fields.robot.joints),
        partial(check_fields, path, fields),
    ]
    found = []
    for check in checks:
        try:
            check()
        except InputError as error:
            found.append(str(error))
    return list(dict.fromkeys(found))


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
    """Names must be known; own effect files must lie in the folder. None of them is run here."""
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
    """What the columns are said to be: the torque's reading, and those that are turned round."""
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
    for column in fields.shifted:
        if column not in columns[: len(joints)]:
            told = ", ".join(columns[: len(joints)])
            raise InputError(f"{path}: shifted: '{column}' is none of {told}; name one of them.")
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
