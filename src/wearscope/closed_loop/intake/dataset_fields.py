"""The fields of `dataset.yaml` as they are read."""

import difflib
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from wearscope import limits
from wearscope.closed_loop.intake.data_folder import read_text
from wearscope.errors import InputError, explain_yaml
from wearscope.robots.servos import ServoFields, read_servos, refuse_bool
from wearscope.storage.plain_yaml import load_plain_yaml, take_label


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
    """Fields of `runs[].payload`."""

    mass: _Number = Field(ge=0.0, le=limits.MASS)
    com: list[_Distance] = Field(default=[0.0, 0.0, 0.0], min_length=3, max_length=3)


def state_payload(payload: PayloadFields | None) -> dict[str, Any] | None:
    """Payload as a robot model states it; None without a payload."""
    return None if payload is None else {"mass": payload.mass, "com": list(payload.com)}


class RunFields(_Fields):
    """Fields of an entry of `runs`."""

    file: str
    use: Literal["train", "test"]
    payload: PayloadFields | None = None
    session: _Label | None = None


class RobotFields(_Fields):
    """Fields of `robot`."""

    urdf: str
    joints: list[str] = Field(min_length=1, max_length=limits.JOINTS)
    inertials: Literal["trusted", "approximate"] = "trusted"
    gravity: list[_Number] = Field(default=[0.0, 0.0, -9.81], min_length=3, max_length=3)
    torque_limit: list[_Number] | None = None
    gear_ratio: list[_Number] | None = None
    rotor_inertia: list[_Number] | None = None
    locked: dict[str, _Number] = {}


class UnitFields(_Fields):
    """Fields of `units`: one unit for all joints, or a list by joint where a robot both turns and slides."""

    q: _PositionUnit | list[_PositionUnit] = "rad"
    tau: _TorqueUnit | list[_TorqueUnit] = "N m"


class DatasetFields(_Fields):
    """Fields of `dataset.yaml`."""

    name: _Label = Field(min_length=1)
    description: str = ""
    source: str = ""
    robot: RobotFields
    sample_rate: _Number = Field(ge=limits.SLOWEST)
    units: UnitFields | None = None
    declared_effects: _Names
    effects: _Names = []
    channels: dict[str, str] = {}
    servo: dict[str, Any] | None = None
    accept: _Names = []
    torque: TorqueReading | dict[str, TorqueReading] = "motor"
    turned: _Names = []
    shifted: dict[str, _Number] = {}
    scaled: dict[str, _Number] = {}
    torque_gain: dict[str, _Number] = {}
    time_scale: Annotated[_Number, Field(gt=0.0)] = 1.0
    reference: list[_Label] = []
    runs: list[RunFields] = Field(min_length=1, max_length=limits.RUNS)

    def readings(self) -> dict[str, TorqueReading]:
        """What each joint's torque column holds, as the field `torque` says."""
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
    """One sentence for each field of a `dataset.yaml` that is wrong by itself.

    Raises
    ------
    InputError
        Where the file cannot be read, or holds no fields.
    """
    return _validate(path, load_fields(path))[1]


def _validate(path: Path, content: dict) -> tuple[DatasetFields | None, list[str]]:
    """Fields as written, or None and one sentence for each that is wrong by itself."""
    try:
        return DatasetFields.model_validate(content), []
    except ValidationError as error:
        found: dict[tuple[str, ...], str] = {}
        for one in error.errors():
            # A field that allows two types has an error for each; the first one is kept.
            place = tuple(str(part) for part in one["loc"] if "[" not in str(part))
            found.setdefault(place, _explain(path, content, one))
        return None, list(dict.fromkeys(found.values()))
    except (RecursionError, ValueError, OverflowError) as error:
        return None, [f"{path}: holds a value that cannot be read ({str(error)[:100]})."]


def _explain(path: Path, content: dict, first: Any) -> str:
    """Sentence that names a wrong field; where a missing field stands there misspelt, it says so."""
    parts = [p for p in first["loc"] if isinstance(p, int) or p.isidentifier()]
    place = ""
    siblings: Any = content
    for k, part in enumerate(parts):
        place += f"[{part}]" if isinstance(part, int) else f".{part}" if place else str(part)
        if isinstance(siblings, dict) and part not in siblings:
            near = difflib.get_close_matches(str(part), [str(key) for key in siblings], n=1, cutoff=0.7)
            if near and k == len(parts) - 1:
                where = f"{path}: {place.rpartition('.')[0]}".rstrip(": ")
                return f"{where}: there is no field '{near[0]}'; did you mean '{part}'?"
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
    return f"{path}: field '{place}' {told[0].lower()}{told[1:]}; correct it as docs/measured-data.md says."


def load_fields(path: Path) -> dict[Any, Any]:
    """Fields of a `dataset.yaml` as they are written, of plain values only.

    Raises
    ------
    InputError
        Where there is no such file, it is no YAML, or it holds no fields.
    """
    remedy = "a data set is a folder with a dataset.yaml in it"
    if (other := path.with_suffix(".yml")).is_file():
        remedy = f"rename {other.name} to {path.name}"
    text = read_text(path, remedy)
    try:
        content = load_plain_yaml(text)
    except yaml.YAMLError as error:
        raise InputError(
            f"{path}: not readable as YAML ({explain_yaml(error)}); correct that line."
        ) from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds no fields; write them as 'field: value'.")
    return content


def read_fields(path: Path, notes: list[str]) -> DatasetFields:
    """Read `dataset.yaml`; fields that are not known are noted, misspelt ones refused.

    Raises
    ------
    InputError
    """
    fields, wrong = _validate(path, load_fields(path))
    if fields is None:
        raise InputError(wrong[0])
    folder_name(fields.name, str(path))
    # `sample_rate` is that of the time column as recorded; times are multiplied by `time_scale`.
    fields.sample_rate /= fields.time_scale
    _refuse_typos(fields, str(path), notes)
    _refuse_typos(fields.robot, f"{path}: robot", notes)
    for i, run in enumerate(fields.runs):
        _refuse_typos(run, f"{path}: runs[{i}]", notes)
        if run.payload is not None:
            _refuse_typos(run.payload, f"{path}: runs[{i}].payload", notes)
    if fields.units is not None:
        _refuse_typos(fields.units, f"{path}: units", notes)
    return fields
