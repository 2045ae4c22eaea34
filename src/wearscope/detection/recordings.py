"""Recordings of a data set as batches for detectors, grouped by motion into nominal and judged ones.

Motions that differ only by waits before, between or after the moves are the same.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from wearscope.closed_loop.inference.problem import Problem
from wearscope.closed_loop.intake.dataset import Dataset
from wearscope.closed_loop.intake.dataset_fields import PayloadFields
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.model.declared import fit_declared_model
from wearscope.closed_loop.model.events import (
    Event,
    find_events,
    mark_events,
    take_out_common,
    take_out_state,
)
from wearscope.closed_loop.model.prediction import find_repeats, predict_reduced
from wearscope.detectors.base import Array, Batch
from wearscope.effects.base import load_effect
from wearscope.errors import InputError


def bridge_events(prepared: Prepared) -> tuple[Prepared, list[Event]]:
    """Recordings without the torque of short events, and the events.

    A push at one link also acts on the other joints, too weakly to be found there. So during an event the
    torques of all joints are replaced, up to the common bandwidth, by what the declared model and each
    joint's state explain. Noise above the bandwidth stays.
    """
    joints = prepared.dataset.joints
    names = [name for name in prepared.dataset.fields.declared_effects if not name.endswith(".py")]
    problem = Problem(prepared, [load_effect(name) for name in names])
    terms = [term for term in problem.declared_terms if not term.is_measurement_error]
    model = fit_declared_model(prepared, terms, problem.inertial, problem.layout.blocks)
    theta = model.solve()
    left = [run.measured - predict_reduced(model, theta, run) for run in prepared.runs]
    left = take_out_state(prepared.runs, left)
    left = take_out_common(prepared.runs, left, find_repeats(prepared))
    events = find_events(prepared.runs, left, joints, prepared.moving, prepared.top_speed)
    if not events:
        return prepared, []
    runs = []
    for run, rest in zip(prepared.runs, left, strict=True):
        t, tau = run.signals.t, run.tau.copy()
        marked = np.any([mark_events(run, t, events, joint) for joint in joints], axis=0)
        for j in range(len(joints)):
            tau[marked, j] -= np.interp(t[marked], run.t, rest[:, j])
        runs.append(replace(run, tau=tau))
    return replace(prepared, runs=runs), events


@dataclass(frozen=True, eq=False)
class Recorded:
    """One recording.

    Attributes
    ----------
    file : str
    session : str or None
    batch : Batch
        Part from its first to its last motion.
    run : PreparedRun
    payload : PayloadFields or None
        Declared payload.
    """

    file: str
    session: str | None
    batch: Batch
    run: PreparedRun
    payload: PayloadFields | None

    @property
    def temperature(self) -> Array:
        """Mean temperature (n,) [deg C]; NaN where it is not measured."""
        return self.run.signals.temperature.mean(axis=0)


@dataclass
class MotionGroup:
    """Recordings of one motion with one payload.

    Attributes
    ----------
    name : str
        ``motion 1``, ``motion 2``, ... in the order of the data set.
    nominal, judged : list of Recorded
    """

    name: str
    nominal: list[Recorded]
    judged: list[Recorded] = field(default_factory=list)


@dataclass(frozen=True)
class Refused:
    """A recording that is not judged, and the reason: a sentence that begins with the file."""

    file: str
    reason: str


def find_nominal(dataset: Dataset) -> set[str]:
    """Files of the nominal runs: those of the `reference` sessions; where none is named, the `train` runs.

    Raises
    ------
    InputError
        Where every run is nominal.
    """
    where, reference = dataset.folder / "dataset.yaml", dataset.fields.reference
    if reference:
        nominal = {run.file for run in dataset.runs if run.session in reference}
    else:
        nominal = {run.file for run in dataset.runs_for("train")}
    if len(nominal) == len(dataset.runs):
        raise InputError(
            f"{where}: runs: every run is nominal, so there is none to judge; add runs of other sessions, or "
            "name the healthy sessions under `reference`."
        )
    return nominal


def make_batch(run: PreparedRun) -> Batch:
    """Batch of a prepared run, from its first to its last motion.

    Raises
    ------
    ValueError
        Where nothing moves.
    """
    s = run.signals
    t = np.arange(len(s.t)) / run.band.rate
    return cut_rests(Batch(t, s.q, s.v, run.tau, run.band.rate))


def sort_recordings(prepared: Prepared) -> tuple[list[MotionGroup], list[Refused]]:
    """Nominal recordings by motion, each with the judged ones of the same motion and declared payload.

    Returns
    -------
    groups : list of MotionGroup
        Groups that have something to judge.
    refused : list of Refused

    Raises
    ------
    InputError
        Where nothing is left to judge.
    """
    dataset = prepared.dataset
    nominal, joints = find_nominal(dataset), dataset.joints
    records = {record.file: record for record in dataset.runs}
    groups: list[MotionGroup] = []
    refused: list[Refused] = []
    usable: list[Recorded] = []
    seen: set[str] = set()
    for run in prepared.runs:
        if run.piece:
            if run.file not in seen:
                told = f"{run.file} has a gap, and detectors need a whole recording; record it again."
                refused.append(Refused(run.file, told))
        else:
            record = records[run.file]
            usable.append(Recorded(run.file, record.session, make_batch(run), run, record.payload))
        seen.add(run.file)
    still = [file for file in records if file not in seen]
    refused += [Refused(file, f"{file}: the robot stands still; record a motion.") for file in still]
    for one in usable:
        if one.file in nominal:
            for group in groups:
                if _tell(group, one, joints) is None:
                    group.nominal.append(one)
                    break
            else:
                groups.append(MotionGroup(f"motion {len(groups) + 1}", [one]))
    for one in usable:
        if one.file in nominal:
            continue
        reasons = [_tell(group, one, joints) for group in groups]
        if None in reasons:
            groups[reasons.index(None)].judged.append(one)
        else:
            refused.append(Refused(one.file, _refusal(one, groups, reasons)))
    found = [group for group in groups if group.judged]
    if not found:
        first = refused[0].reason if refused else "there is no whole nominal recording"
        raise InputError(f"{dataset.folder}: nothing can be judged: {first}")
    return found, refused


def _tell(group: MotionGroup, one: Recorded, joints: list[str]) -> str | None:
    """Why a recording does not belong to a group; None where it does."""
    first = group.nominal[0]
    said = tell_difference(first.batch, one.batch, joints)
    if said is None and _load(first) != _load(one):
        return "it declares another payload"
    return said


def _load(one: Recorded) -> tuple[float, ...]:
    return () if one.payload is None else (one.payload.mass, *one.payload.com)


def _refusal(one: Recorded, groups: list[MotionGroup], reasons: list[str | None]) -> str:
    if not groups:
        return f"{one.file}: there is no whole nominal recording; record one of the same motion."
    near = next((k for k, said in enumerate(reasons) if said == "it declares another payload"), 0)
    what = f"{groups[near].nominal[0].file} ({reasons[near]})"
    others = f" and of {len(groups) - 1} other nominal motions" if len(groups) > 1 else ""
    return (
        f"{one.file} is of another motion than the nominal {what}{others}; record the nominal motion, or add "
        "a nominal recording of this one."
    )


#: A joint counts as moving above this share of its highest speed.
REST = 0.01
#: Number of places along the path at which two motions are compared.
PLACES = 400
#: Two motions are the same within these limits: difference of a position, as a share of the joint's range,
#: and of the time in motion up to a place, as a share of the whole time. Tracking errors, wear and
#: temperature change both far less.
POSITION, TIME = 0.05, 0.05
#: A joint's range counts as at least this share of the largest range: a joint that hardly moves shows only
#: noise.
LEAST_RANGE = 0.02


@dataclass(frozen=True)
class Path:
    """Positions along the path of a motion, without its rests.

    Attributes
    ----------
    q : ndarray (PLACES, n)
        Positions at equal shares of the path.
    time : ndarray (PLACES,)
        Time in motion up to there [s].
    """

    q: Array
    time: Array


def cut_rests(batch: Batch) -> Batch:
    """Batch from the first to the last sample at which a joint moves.

    Raises
    ------
    ValueError
        Where none does.
    """
    moving = np.flatnonzero(find_moving(batch, top_speeds(batch)))
    if len(moving) < 2:
        raise ValueError("no joint moves")
    part = slice(moving[0], moving[-1] + 1)
    return Batch(batch.t[part], batch.q[part], batch.qd[part], batch.tau[part], batch.sample_rate)


def top_speeds(batch: Batch) -> Array:
    """Highest speed (n,) of each joint; infinite for a joint that hardly moves compared with the others."""
    top = np.abs(batch.qd).max(axis=0)
    return np.where(np.ptp(batch.q, axis=0) >= _scale(batch), top, np.inf)


def find_moving(batch: Batch, top: Array) -> np.ndarray:
    """Mask (N,) of samples at which any joint moves faster than `REST` of its highest speed `top` (n,)."""
    return np.asarray((np.abs(batch.qd) > REST * top).any(axis=1))


def _scale(batch: Batch) -> Array:
    reach = np.ptp(batch.q, axis=0)
    return np.maximum(reach, LEAST_RANGE * reach.max())


def follow_path(batch: Batch, top: Array) -> Path:
    """Path of a batch; its length is the sum of all joints' travel, each over the joint's highest speed.

    Parameters
    ----------
    batch : Batch
    top : ndarray (n,)
        Highest speeds of the motion with which the path is compared.

    Raises
    ------
    ValueError
        Where no joint moves.
    """
    moving = find_moving(batch, top)
    progress = np.where(moving, (np.abs(batch.qd) / top).sum(axis=1), 0.0)
    if not progress.any():
        raise ValueError("no joint moves")
    way = np.cumsum(progress) - 0.5 * progress
    time = np.cumsum(moving) / batch.sample_rate
    share = np.linspace(0.0, 1.0, PLACES)
    at = way[moving] / progress.sum()
    q = np.column_stack([np.interp(share, at, x) for x in batch.q[moving].T])
    return Path(q, np.interp(share, at, time[moving]))


def tell_difference(reference: Batch, other: Batch, joints: list[str]) -> str | None:
    """Why another recording is of another motion, in words; None where the motion is the same.

    Parameters
    ----------
    reference, other : Batch
    joints : list of str
    """
    top = top_speeds(reference)
    try:
        first, second = follow_path(reference, top), follow_path(other, top)
    except ValueError as error:
        return str(error)
    away = np.abs(second.q - first.q) / _scale(reference)
    place, j = (int(k) for k in np.unravel_index(np.argmax(away), away.shape))
    if away[place, j] > POSITION:
        far = (
            f"{100 * away[place, j]:.0f} % of its range"
            if away[place, j] <= 1.0
            else "more than its whole range"
        )
        return f"joint '{joints[j]}' is {far} away after {100 * place / (PLACES - 1):.0f} % of the way"
    late = (second.time - first.time) / first.time[-1]
    place = int(np.argmax(np.abs(late)))
    if abs(late[place]) > TIME:
        word = "slower" if late[place] > 0 else "faster"
        return f"it is {word}, by {100 * abs(late[place]):.0f} % of the time in motion"
    return None
