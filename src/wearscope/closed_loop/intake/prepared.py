"""A data set prepared for regression: runs as signals of one bandwidth, the known torque, rows that count."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import interpolate

from wearscope.closed_loop.intake.dataset import Dataset, RunRecord
from wearscope.closed_loop.intake.direction import Reversals
from wearscope.closed_loop.intake.filtering import Band, decimate, thin
from wearscope.closed_loop.intake.lost_motion import choose_lost_motion_cutoffs
from wearscope.closed_loop.intake.rough_model import RestBridge
from wearscope.effects.base import Parameter, Signals
from wearscope.errors import InputError

#: Fewest rows of a run after the filters.
LEAST_ROWS = 40


@dataclass
class PreparedRun:
    """One run, or piece of one, ready for regression.

    Attributes
    ----------
    file, use : str
    signals : Signals
        At `Band.rate`; time since the recording's first row.
    tau : ndarray (N, n)
        Measured torque; samples that are no measurements are bridged and do not count.
    known : ndarray (N, n)
        Torque of the rigid body and of declared rotor inertias as the data set states them.
    band : Band
    keep : ndarray (M, n) of bool
        Rows that count for each joint: the joint moves and the torque is not saturated.
    t : ndarray (M,)
        Time of the rows since the recording's first row [s].
    start : float
        Time of the recording's first row on its own clock [s].
    piece : int
        Number of the piece of the recording from 1; 0 where it is whole.
    session : str or None
    resting : ndarray (N, n) of bool
        Samples of a rest, at which there is no direction of motion.
    factor : int
        One of so many samples of the recording is kept.
    bridges : dict of int to RestBridge
        By joint that rests, what replaces a torque at rest before the common filter.
    """

    file: str
    use: str
    signals: Signals
    tau: np.ndarray
    known: np.ndarray
    band: Band
    keep: np.ndarray
    t: np.ndarray
    start: float = 0.0
    piece: int = 0
    session: str | None = None
    resting: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    factor: int = 1
    bridges: dict[int, RestBridge] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Name that no other run has: the file, and the number of the piece where there are several."""
        return f"{self.file}#{self.piece}" if self.piece else self.file

    def reduce(self, x: np.ndarray) -> np.ndarray:
        """Common filter, then one row in `Band.stride`, edges cut: (N, ...) to (M, ...)."""
        reduced = thin(x.reshape(len(x), -1), self.band)
        return reduced.reshape(len(reduced), *x.shape[1:])

    def reduce_columns(self, x: np.ndarray, joint: int | None = None) -> np.ndarray:
        """Regressors of torques after the common filter, rests bridged for rows in motion.

        Parameters
        ----------
        x : ndarray (N, n, ...), or (N, ...) of one joint
        joint : int, optional
            The one joint.
        """
        reduced = self.reduce(x)
        for j, bridge in self.bridges.items():
            if joint is None or joint == j:
                at = np.s_[:, j] if joint is None else np.s_[:]
                changed = bridge.change(x[at].reshape(len(x), -1))
                reduced[at] += changed.reshape(reduced[at].shape)
        return reduced

    def reduce_torque(self, x: np.ndarray) -> np.ndarray:
        """Torques (N, n) of a machine along the motion after the common filter, rests bridged: (M, n)."""
        return self.reduce(self.known) + self.reduce_columns(x - self.known)

    @cached_property
    def measured(self) -> np.ndarray:
        """Measured torque (M, n) after the common filter, rests bridged."""
        return self.reduce_torque(self.tau)

    @cached_property
    def bodies(self) -> np.ndarray:
        """Regressor (M, n, 10 n) of the links' inertial parameters after the common filter."""
        s = self.signals
        return self.reduce_columns(s.rigid_body.inertial_regressor(s.q, s.v, s.a))


@dataclass
class Prepared:
    """A data set ready for regression.

    Attributes
    ----------
    dataset : Dataset
    urdf : str
        Normalised URDF.
    runs : list of PreparedRun
    band : Band
        Of the runs; its rate is that of the recordings or a whole part of it.
    moving : ndarray (n,) of bool
        Joints that move in at least one training run.
    notes : list of str
    reversals : Reversals
        How each joint's direction of motion changes.
    top_speed : ndarray (n,)
        Largest speed of each joint in the training runs [rad/s or m/s].
    link_side : frozenset of str
        Joints whose torque shows no friction, as if measured behind the gear.
    torque_factors : dict of str to float
        By joint, the recorded torque over what the stated bodies need, where it clearly differs from 1.
    noted : dict of (str, int) to float
        By effect and joint, the first coefficient that the reading of the columns estimated.
    checked : list of str
        The notes that `check_plausibility` added.
    """

    dataset: Dataset
    urdf: str
    runs: list[PreparedRun]
    band: Band
    moving: np.ndarray
    notes: list[str]
    reversals: Reversals = field(default_factory=lambda: Reversals.over(np.zeros(0)))
    top_speed: np.ndarray = field(default_factory=lambda: np.zeros(0))
    link_side: frozenset[str] = frozenset()
    torque_factors: dict[str, float] = field(default_factory=dict)
    noted: dict[tuple[str, int], float] = field(default_factory=dict)
    checked: list[str] = field(default_factory=list)

    @property
    def torque_readings(self) -> dict[str, str]:
        """How each joint's torque column was read."""
        stated = self.dataset.fields.readings()
        return {
            joint: "link" if reading == "motor" and joint in self.link_side else reading
            for joint, reading in stated.items()
        }

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.dataset.joints)

    @cached_property
    def lost_motion_cutoff(self) -> np.ndarray:
        """Cut-off (n,) [Hz] of the torque whose reversals tell when each gear takes up its lost motion."""
        runs = self.runs_for("train") or self.runs
        return choose_lost_motion_cutoffs([run.signals for run in runs], self.band)

    @cached_property
    def load_size(self) -> np.ndarray:
        """RMS (n,) of each joint's load in the training runs, along the motion [N m or N]."""
        runs = self.runs_for("train") or self.runs
        square = sum((run.signals.load**2).sum(axis=0) for run in runs)
        return np.asarray(np.sqrt(square / sum(len(run.signals.t) for run in runs)))

    def refuse(self, where: str, told: str, *codes: str) -> None:
        """Refuse by inference, or add a note where the data set accepts every code."""
        note = self.dataset.accepted.refuse(where, told, *codes)
        if note not in self.notes:
            self.notes.append(note)

    def bound(self, parameters: Iterable[Parameter], joint: int) -> list[tuple[float, float]]:
        """Physically believable bounds of an effect's parameters at a joint."""
        unit, load = self.dataset.position_unit[joint], float(self.load_size[joint])
        return [p.bounds(unit, load) for p in parameters]

    def runs_for(self, use: str) -> list[PreparedRun]:
        """Runs of one use."""
        return [run for run in self.runs if run.use == use]

    def record_of(self, run: PreparedRun) -> RunRecord:
        """Recording that a run is, or is a piece of."""
        return next(one for one in self.dataset.runs if one.file == run.file)

    def reverse_over(self, reversals: Reversals) -> "Prepared":
        """The same data set with other reversals of the direction of motion."""
        return replace(self, runs=[_reverse_over(run, reversals) for run in self.runs], reversals=reversals)

    def try_reversals(self, reversals: Reversals, joint: int | None = None) -> list[PreparedRun]:
        """Training runs with other reversals of the direction of motion, for an effect's columns alone.

        They have no derivatives with respect to the reversal. With `joint`, only that joint's direction
        changes.
        """
        joints = list(range(self.n)) if joint is None else [joint]
        return [_try_reversals(run, reversals, joints) for run in self.runs_for("train")]


def leave_out_short(
    dataset: Dataset, runs: list[PreparedRun], band: Band, notes: list[str]
) -> list[PreparedRun]:
    """Runs of at least `LEAST_ROWS` rows; shorter pieces are left out, with a note.

    Raises
    ------
    InputError
        Where nothing is left of a recording.
    """
    kept = [run for run in runs if len(run.t) >= LEAST_ROWS]
    for run in runs:
        if len(run.t) < LEAST_ROWS:
            if run.file not in {other.file for other in kept}:
                where = dataset.folder / run.file
                seconds = np.ceil(
                    10.0 * (run.signals.t[-1] + (LEAST_ROWS - len(run.t)) * band.stride / band.rate)
                )
                raise InputError(
                    f"{where}: {run.signals.t[-1]:.3g} s are too short for a {band.torque:.3g} Hz filter; "
                    f"record at least {seconds / 10.0:g} s."
                )
            notes.append(f"{run.label}: too short for a {band.torque:.3g} Hz filter; the piece is left out.")
    return kept


def known_inertia(dataset: Dataset) -> np.ndarray:
    """Declared rotor inertias (n,) whose values the data set gives [kg m^2 or kg]; zero where it does not."""
    stated = dataset.fields.robot.rotor_inertia
    if stated is None or "rotor_inertia" not in dataset.fields.declared_effects:
        return np.zeros(len(dataset.joints))
    return np.array(stated, dtype=float)


def take_direction(v: np.ndarray, rest: np.ndarray, reversals: Reversals) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed direction of motion (N, n), and its derivatives (N, n, 3) with respect to the reversals."""
    sharp = np.where(rest, 0.0, np.sign(v))
    return reversals.soften(v, sharp), reversals.vary(v, sharp)


def _reverse_over(run: PreparedRun, reversals: Reversals) -> PreparedRun:
    """A run with other reversals of the direction of motion."""
    sign, reversal = take_direction(*_at_full_rate(run, list(range(run.signals.v.shape[1]))), reversals)
    signals = replace(run.signals, sign=decimate(sign, run.factor), reversal=decimate(reversal, run.factor))
    return replace(run, signals=signals)


def _try_reversals(run: PreparedRun, reversals: Reversals, joints: list[int]) -> PreparedRun:
    """A run with other reversals at some joints, without `reversal`."""
    v, rest = _at_full_rate(run, joints)
    own = Reversals(reversals.width[joints], reversals.form[joints])
    sign = run.signals.sign.copy()
    sign[:, joints] = decimate(own.soften(v, np.where(rest, 0.0, np.sign(v))), run.factor)
    return replace(run, signals=replace(run.signals, sign=sign, reversal=None))


def _at_full_rate(run: PreparedRun, joints: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Speeds of some joints, and where these rest, brought back to the recording's rate.

    Speeds are smooth between the samples kept.
    """
    v, rest = run.signals.v[:, joints], run.resting[:, joints]
    if run.factor > 1:
        at = np.arange(len(v)) * run.factor
        every = np.arange(at[-1] + 1)
        v = interpolate.CubicSpline(at, v)(every)
        rest = rest[every // run.factor]
    return v, rest
