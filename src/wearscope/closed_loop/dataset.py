"""A measured data set: one folder in the form of the measured-data contract, read and refused.

What a folder says is checked here against itself (fields, columns, rows, rates); what its signals say about
units, sides and signs is checked in `wearscope.closed_loop.plausibility`.
"""

import difflib
import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from wearscope import plugins
from wearscope.errors import InputError

_STILL = 1e-9


class _Fields(BaseModel):
    model_config = ConfigDict(extra="allow", strict=False)


class PayloadFields(_Fields):
    """`runs[].payload`."""

    mass: float = Field(ge=0.0, allow_inf_nan=False)
    com: list[float] = Field(default=[0.0, 0.0, 0.0], min_length=3, max_length=3)


class RunFields(_Fields):
    """`runs[]`."""

    file: str
    use: Literal["train", "test"]
    payload: PayloadFields | None = None


class RobotFields(_Fields):
    """`robot`."""

    urdf: str
    joints: list[str] = Field(min_length=1)
    inertials: Literal["trusted", "approximate"] = "trusted"
    gravity: list[float] = Field(default=[0.0, 0.0, -9.81], min_length=3, max_length=3)
    torque_limit: list[float] | None = None
    gear_ratio: list[float] | None = None
    rotor_inertia: list[float] | None = None


class UnitFields(_Fields):
    """`units`."""

    q: Literal["rad", "m"] = "rad"
    tau: Literal["N m", "N"] = "N m"


class DatasetFields(_Fields):
    """`dataset.yaml`."""

    name: str = Field(min_length=1)
    description: str = ""
    source: str = ""
    robot: RobotFields
    sample_rate: float = Field(gt=0.0, allow_inf_nan=False)
    units: UnitFields | None = None
    declared_effects: list[str]
    runs: list[RunFields] = Field(min_length=1)


@dataclass
class Run:
    """One recording.

    Attributes
    ----------
    file : str
    use : str
        ``train`` or ``test``.
    t : ndarray (N,)
        Time [s] as recorded.
    q, tau : ndarray (N, n)
        Joint position and joint-side torque.
    qd, temperature : ndarray (N, n) or None
        Joint speed where given; temperature [deg C], NaN for joints that have none.
    payload : PayloadFields or None
    """

    file: str
    use: str
    t: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    qd: np.ndarray | None
    temperature: np.ndarray | None
    payload: PayloadFields | None


@dataclass
class Dataset:
    """A measured data set as read.

    Attributes
    ----------
    folder : Path
    fields : DatasetFields
    runs : list of Run
    position_unit, torque_unit : list of str
        By joint.
    notes : list of str
        What a reader should know and that is no breach.
    """

    folder: Path
    fields: DatasetFields
    runs: list[Run]
    position_unit: list[str]
    torque_unit: list[str]
    notes: list[str] = field(default_factory=list)

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

    def runs_for(self, use: str) -> list[Run]:
        """Runs of one use, in the order of the file."""
        return [run for run in self.runs if run.use == use]


def _refuse_typos(fields: BaseModel, where: str, notes: list[str]) -> None:
    known = list(type(fields).model_fields)
    for key in fields.model_extra or {}:
        near = difflib.get_close_matches(str(key), known, n=1, cutoff=0.75)
        if near:
            raise InputError(f"{where}: there is no field '{key}'; did you mean '{near[0]}'?")
        notes.append(f"{where}: field '{key}' is not known and was not used.")


def _read_fields(path: Path, notes: list[str]) -> DatasetFields:
    try:
        content: Any = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(
            f"{path}: no such file; a data set is a folder with a dataset.yaml in it."
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        line = str(error).replace("\n", " ")
        raise InputError(f"{path}: not readable as YAML ({line}); mend that line.") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds no fields; write them as 'field: value'.")
    if "sample_rate" in content and isinstance(content["sample_rate"], bool):
        raise InputError(f"{path}: field 'sample_rate' is no number; give the rate in Hz.")
    try:
        fields = DatasetFields.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        for key in content:
            if difflib.get_close_matches(str(key), [str(first["loc"][0])], cutoff=0.75) and key not in (
                DatasetFields.model_fields
            ):
                raise InputError(f"{path}: there is no field '{key}'; did you mean '{place}'?") from error
        raise InputError(f"{path}: field '{place}': {first['msg'].lower()}; see the format.") from error
    _refuse_typos(fields, str(path), notes)
    _refuse_typos(fields.robot, f"{path}: robot", notes)
    for i, run in enumerate(fields.runs):
        _refuse_typos(run, f"{path}: runs[{i}]", notes)
    return fields


def _check_fields(path: Path, fields: DatasetFields) -> None:
    joints = fields.robot.joints
    if len(set(joints)) < len(joints):
        raise InputError(f"{path}: robot.joints names a joint twice; name each once.")
    for name in ("torque_limit", "gear_ratio", "rotor_inertia"):
        values = getattr(fields.robot, name)
        if values is not None and len(values) != len(joints):
            raise InputError(
                f"{path}: robot.{name} has {len(values)} values for {len(joints)} joints; give one a joint."
            )
        if values is not None and not np.all(np.isfinite(values)):
            raise InputError(f"{path}: robot.{name} holds a value that is no finite number; mend it.")
    if fields.robot.rotor_inertia is not None and min(fields.robot.rotor_inertia) < 0:
        raise InputError(f"{path}: robot.rotor_inertia holds a negative value; give kg m^2 at the joint.")
    if fields.robot.torque_limit is not None and min(fields.robot.torque_limit) <= 0:
        raise InputError(f"{path}: robot.torque_limit must be positive; give the limit of each joint.")
    known = [name for name in plugins.list_names("effects", "EFFECT") if name != "unknown"]
    for name in fields.declared_effects:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean '{near[0]}'?" if near else f"; choose from {', '.join(known)}."
            raise InputError(f"{path}: declared_effects: there is no effect '{name}'{hint}")
    if len(set(fields.declared_effects)) < len(fields.declared_effects):
        raise InputError(f"{path}: declared_effects names an effect twice; name each once.")
    files = [run.file for run in fields.runs]
    for file in files:
        if files.count(file) > 1:
            raise InputError(f"{path}: runs names {file} more than once; a run is either train or test.")
    for use in ("train", "test"):
        if not any(run.use == use for run in fields.runs):
            raise InputError(f"{path}: no run has 'use: {use}'; give at least one.")


def _read_columns(path: Path) -> pd.DataFrame:
    if not path.is_file():
        raise InputError(f"{path}: no such file; mend runs[].file in dataset.yaml or add the file.")
    try:
        if path.suffix == ".csv":
            table = pyarrow.csv.read_csv(path)
        elif path.suffix == ".parquet":
            table = pq.read_table(path, partitioning=None)
        else:
            raise InputError(f"{path}: is neither .parquet nor .csv; convert it to one of them.")
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(
            f"{path}: cannot be read whole ({str(error).splitlines()[0]}); copy the file again."
        ) from error
    return table.to_pandas()


def _take(path: Path, frame: pd.DataFrame, columns: list[str]) -> np.ndarray:
    missing = [name for name in columns if name not in frame.columns]
    if missing:
        raise InputError(f"{path}: column '{missing[0]}' is missing; add it, or mend robot.joints.")
    taken = np.empty((len(frame), len(columns)))
    for i, name in enumerate(columns):
        series = frame[name]
        if not pd.api.types.is_numeric_dtype(series) or pd.api.types.is_bool_dtype(series):
            raise InputError(f"{path}: column '{name}' holds text, not numbers; convert it.")
        taken[:, i] = series.to_numpy(dtype=float, na_value=np.nan)
        bad = np.flatnonzero(~np.isfinite(taken[:, i]))
        if len(bad):
            raise InputError(
                f"{path}: column '{name}' is no finite number at row {bad[0]} "
                f"({len(bad)} in all); cut or mend these rows."
            )
    return taken


def _check_time(path: Path, t: np.ndarray, rate: float) -> None:
    if len(t) < 50 or t[-1] - t[0] < 1.0:
        raise InputError(f"{path}: holds {len(t)} rows; a run needs at least 50 rows and one second.")
    steps = np.diff(t)
    back = np.flatnonzero(steps <= 0)
    if len(back):
        raise InputError(
            f"{path}: column 't' does not increase at row {back[0] + 1} "
            f"({t[back[0]]:g} s, then {t[back[0] + 1]:g} s); sort the rows and drop repeated ones."
        )
    period = float(np.median(steps))
    if abs(period * rate - 1.0) > 0.01:
        raise InputError(
            f"{path}: column 't' steps by {period:g} s, which is {1 / period:.6g} Hz, "
            f"where sample_rate says {rate:g} Hz; mend one of them."
        )
    jump = np.flatnonzero(steps > 1.5 * period)
    if len(jump):
        raise InputError(
            f"{path}: column 't' jumps by {steps[jump[0]]:g} s at row {jump[0] + 1}; "
            "split the run there or fill the gap."
        )


def _read_run(folder: Path, entry: RunFields, joints: list[str], rate: float) -> Run:
    path = folder / entry.file
    frame = _read_columns(path)
    t = _take(path, frame, ["t"])[:, 0]
    _check_time(path, t, rate)
    q = _take(path, frame, [f"q_{joint}" for joint in joints])
    tau = _take(path, frame, [f"tau_{joint}" for joint in joints])
    qd = None
    given = [joint for joint in joints if f"qd_{joint}" in frame.columns]
    if len(given) == len(joints):
        qd = _take(path, frame, [f"qd_{joint}" for joint in joints])
    elif given:
        raise InputError(
            f"{path}: column 'qd_{given[0]}' is given but not qd of every joint; give all or none."
        )
    temperature = None
    if any(f"temp_{joint}" in frame.columns for joint in joints):
        temperature = np.full(q.shape, np.nan)
        for i, joint in enumerate(joints):
            if f"temp_{joint}" in frame.columns:
                temperature[:, i] = _take(path, frame, [f"temp_{joint}"])[:, 0]
        if np.nanmin(temperature) < -60 or np.nanmax(temperature) > 250:
            raise InputError(f"{path}: a temperature lies outside -60..250 deg C; give deg C.")
    for i, joint in enumerate(joints):
        if np.ptp(tau[:, i]) == 0.0:
            raise InputError(
                f"{path}: column 'tau_{joint}' is constant ({tau[0, i]:g}); the channel is dead or saturated, "
                "record it again or leave the joint out."
            )
    return Run(entry.file, entry.use, t, q, tau, qd, temperature, entry.payload)


def _check_repeats(path: Path, runs: list[Run]) -> None:
    """Refuse a test run whose recorded torque is that of a train run."""
    for test in (run for run in runs if run.use == "test"):
        for train in (run for run in runs if run.use == "train"):
            short = min(len(test.t), len(train.t))
            digest = [
                {hashlib.blake2b(row.tobytes(), digest_size=8).digest() for row in run.tau}
                for run in (test, train)
            ]
            distinct = min(len(digest[0]), len(digest[1]))
            shared = len(digest[0] & digest[1])
            if distinct > 0.2 * short and shared > 0.3 * distinct:
                raise InputError(
                    f"{path}: the test run {test.file} repeats the train run {train.file} "
                    f"({shared} equal rows); give a run that was recorded apart."
                )


def _check_units(path: Path, fields: DatasetFields, prismatic: list[bool]) -> tuple[list[str], list[str]]:
    units = fields.units
    joints = fields.robot.joints
    for joint, slides in zip(joints, prismatic, strict=True):
        q, tau = ("m", "N") if slides else ("rad", "N m")
        mixed = any(prismatic) and not all(prismatic)
        if mixed:
            continue
        stated = units or UnitFields()
        if (stated.q, stated.tau) != (q, tau):
            kind = "prismatic" if slides else "revolute"
            raise InputError(
                f"{path}: units say q: {stated.q}, tau: {stated.tau}, but joint '{joint}' is {kind}; "
                f"convert the columns to {q} and {tau} and say so."
            )
    return ["m" if s else "rad" for s in prismatic], ["N" if s else "N m" for s in prismatic]


def read_dataset(folder: str | Path, prismatic: Any) -> Dataset:
    """Read a data-set folder.

    Parameters
    ----------
    folder : path-like
        Folder with a ``dataset.yaml``.
    prismatic : callable
        Called with the URDF's path and the joint names; says of each joint whether it is prismatic, and
        refuses joints that the URDF does not have.

    Raises
    ------
    InputError
        Where the folder breaks the format; the sentence names the file, the field or the row.
    """
    folder = Path(folder)
    path = folder / "dataset.yaml"
    notes: list[str] = []
    fields = _read_fields(path, notes)
    _check_fields(path, fields)
    if not (folder / fields.robot.urdf).is_file():
        raise InputError(f"{folder / fields.robot.urdf}: no such file; mend robot.urdf in dataset.yaml.")
    units = _check_units(path, fields, prismatic(folder / fields.robot.urdf, fields.robot.joints))
    runs = [_read_run(folder, entry, fields.robot.joints, fields.sample_rate) for entry in fields.runs]
    _check_repeats(path, runs)
    return Dataset(folder, fields, runs, *units, notes)
