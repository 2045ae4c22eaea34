"""A measured data set: one folder in the form of the measured-data contract, read and refused.

What a folder says is checked here against itself (fields, columns, rows, rates); what its signals say about
units, sides and signs is checked in `wearscope.closed_loop.intake.plausibility`.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
from scipy import signal

from wearscope.closed_loop.intake.dataset_fields import (
    DatasetFields,
    PayloadFields,
    RunFields,
    UnitFields,
    check_fields,
    read_fields,
)
from wearscope.errors import InputError

#: Runs whose aligned channels differ by less than this share of their spread are copies of each other.
_COPY = 1e-3
_LEAST_ROWS, _LEAST_TIME = 50, 1.0


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
        Joint speed and temperature [deg C]: None where no joint has any, NaN for joints that have none.
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


def _read_columns(path: Path) -> pd.DataFrame:
    if not path.is_file():
        raise InputError(f"{path}: no such file; mend runs[].file in dataset.yaml or add the file.")
    try:
        if path.suffix.lower() == ".csv":
            table = pyarrow.csv.read_csv(path)
        elif path.suffix.lower() == ".parquet":
            table = pq.read_table(path, partitioning=None)
        else:
            raise InputError(f"{path}: is neither .parquet nor .csv; convert it to one of them.")
    except (pa.ArrowException, OSError) as error:
        told = str(error).replace(str(path), "it").splitlines()[0].rstrip(".")
        raise InputError(f"{path}: cannot be read whole ({told}); copy the file again.") from error
    names = table.column_names
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{path}: column '{name}' stands twice; keep one of them.")
    return table.to_pandas()


def _take(path: Path, frame: pd.DataFrame, name: str) -> np.ndarray:
    """One column as finite numbers."""
    if name not in frame.columns:
        near = [c for c in map(str, frame.columns) if c.strip().lower() == name.lower()]
        hint = f"rename '{near[0]}'" if near else "add it, or mend robot.joints"
        raise InputError(f"{path}: column '{name}' is missing; {hint}.")
    series = frame[name]
    if not pd.api.types.is_numeric_dtype(series) or pd.api.types.is_bool_dtype(series):
        numbers = pd.to_numeric(series, errors="coerce")
        row = int(np.argmax(numbers.isna().to_numpy()))
        if not len(series):
            raise InputError(f"{path}: holds 0 rows; a run needs at least {_LEAST_ROWS} rows and one second.")
        raise InputError(
            f"{path}: column '{name}' holds text or dates, not numbers "
            f"(row {row}: {str(series.iloc[row])[:30]!r}); convert it."
        )
    values = np.array(series.to_numpy(dtype=float, na_value=np.nan))
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise InputError(
            f"{path}: column '{name}' is no finite number at row {bad[0]} "
            f"({len(bad)} in all); cut or mend these rows."
        )
    return values


def _take_all(path: Path, frame: pd.DataFrame, kind: str, joints: list[str]) -> np.ndarray:
    return np.column_stack([_take(path, frame, f"{kind}_{joint}") for joint in joints])


def _take_given(path: Path, frame: pd.DataFrame, kind: str, joints: list[str]) -> np.ndarray | None:
    """Columns of one kind, NaN for the joints that have none; None where no joint has."""
    given = [joint for joint in joints if f"{kind}_{joint}" in frame.columns]
    if not given:
        return None
    taken = np.full((len(frame), len(joints)), np.nan)
    for joint in given:
        taken[:, joints.index(joint)] = _take(path, frame, f"{kind}_{joint}")
    return taken


def _check_time(path: Path, t: np.ndarray, rate: float) -> None:
    if len(t) < _LEAST_ROWS:
        raise InputError(
            f"{path}: holds {len(t)} rows; a run needs at least {_LEAST_ROWS} rows and one second."
        )
    steps = np.diff(t)
    back = np.flatnonzero(steps <= 0)
    if len(back):
        raise InputError(
            f"{path}: column 't' does not increase at row {back[0] + 1} "
            f"({t[back[0]]:.10g} s, then {t[back[0] + 1]:.10g} s); sort the rows and drop repeated ones."
        )
    period = float(np.median(steps))
    if abs(period * rate - 1.0) > 0.01:
        raise InputError(
            f"{path}: column 't' steps by {period:.6g} s, which is {1 / period:.6g} Hz, "
            f"where sample_rate says {rate:g} Hz; mend one of them."
        )
    jump = np.flatnonzero(steps > 1.5 * period)
    if len(jump):
        raise InputError(
            f"{path}: column 't' jumps by {steps[jump[0]]:.6g} s at row {jump[0] + 1}; "
            "split the run there or fill the gap."
        )
    mean = float((t[-1] - t[0]) / (len(t) - 1))
    if abs(mean * rate - 1.0) > 0.01:
        raise InputError(
            f"{path}: column 't' steps by {mean:.6g} s on average, which is {1 / mean:.6g} Hz, "
            f"where sample_rate says {rate:g} Hz; mend one of them."
        )
    if t[-1] - t[0] < _LEAST_TIME:
        raise InputError(f"{path}: lasts {t[-1] - t[0]:.3g} s; a run needs at least one second.")


def _read_run(folder: Path, entry: RunFields, joints: list[str], rate: float) -> Run:
    path = folder / entry.file
    frame = _read_columns(path)
    t = _take(path, frame, "t")
    _check_time(path, t, rate)
    q = _take_all(path, frame, "q", joints)
    tau = _take_all(path, frame, "tau", joints)
    qd = _take_given(path, frame, "qd", joints)
    temperature = _take_given(path, frame, "temp", joints)
    if temperature is not None and (np.nanmin(temperature) < -60 or np.nanmax(temperature) > 250):
        raise InputError(f"{path}: a temperature lies outside -60..250 deg C; give deg C.")
    for i, joint in enumerate(joints):
        if np.ptp(tau[:, i]) == 0.0:
            raise InputError(
                f"{path}: column 'tau_{joint}' is constant ({tau[0, i]:g}); the channel is dead or "
                "saturated, record it again or leave the joint out."
            )
    return Run(entry.file, entry.use, t, q, tau, qd, temperature, entry.payload)


def _shift_between(a: np.ndarray, b: np.ndarray) -> int:
    """Row of `a` at which `b` fits best, by the torque that varies most; negative where b starts earlier."""
    j = int(np.argmax(a.std(axis=0)))
    match = signal.correlate(a[:, j] - a[:, j].mean(), b[:, j] - b[:, j].mean(), mode="full", method="fft")
    return int(np.argmax(match)) - (len(b) - 1)


def _is_copy(a: Run, b: Run) -> bool:
    """Whether two runs hold one recording: channels alike to a share of their spread that noise never is."""
    shift = _shift_between(a.tau, b.tau)
    first, second = max(shift, 0), max(-shift, 0)
    shared = min(len(a.t) - first, len(b.t) - second)
    if shared < max(_LEAST_ROWS, 0.2 * min(len(a.t), len(b.t))):
        return False
    for x, y in ((a.tau, b.tau), (a.q, b.q)):
        one, other = x[first : first + shared], y[second : second + shared]
        spread = np.maximum(one.std(axis=0), 1e-12)
        if np.any(np.quantile(np.abs(one - other), 0.9, axis=0) > _COPY * spread):
            return False
    return True


def _check_repeats(path: Path, runs: list[Run]) -> None:
    """Refuse a run that is another one over again: what is held out must have been recorded apart."""
    for k, run in enumerate(runs):
        for other in runs[:k]:
            if "train" in (run.use, other.use) and _is_copy(run, other):
                again, first = (run, other) if run.use == "test" or other.use == "train" else (other, run)
                raise InputError(
                    f"{path}: the {again.use} run {again.file} repeats the {first.use} run {first.file}; "
                    "give a run that was recorded apart."
                )


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
    fields = read_fields(path, notes)
    check_fields(path, fields)
    if not (folder / fields.robot.urdf).is_file():
        raise InputError(f"{folder / fields.robot.urdf}: no such file; mend robot.urdf in dataset.yaml.")
    units = _check_units(path, fields, prismatic(folder / fields.robot.urdf, fields.robot.joints))
    runs = [_read_run(folder, entry, fields.robot.joints, fields.sample_rate) for entry in fields.runs]
    _check_repeats(path, runs)
    return Dataset(folder, fields, runs, *units, notes)
