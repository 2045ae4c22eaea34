"""Cleaned recordings, and which joints and runs of them move."""

from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from wearscope.closed_loop.intake.cleaning import QUANTA, clean_run
from wearscope.closed_loop.intake.clock import mark_losses, resample, space_evenly, split_at_gaps
from wearscope.closed_loop.intake.dataset import Dataset, RunRecord
from wearscope.closed_loop.intake.dataset_fields import PayloadFields
from wearscope.closed_loop.intake.pushes import say_pushes
from wearscope.closed_loop.intake.recording import Run
from wearscope.closed_loop.intake.table_files import LEAST_ROWS, LEAST_TIME
from wearscope.errors import InputError
from wearscope.robots.dynamics import Payload, RigidBody
from wearscope.robots.spatial import unwrap_turns

#: A joint rests below this share of the range of the joint that moves furthest; a run rests below this share
#: of the runs' usual range. Least span of a joint that moves [rad or m].
RESTS, _LEAST_MOTION = 1e-3, 1e-5
#: Largest span [rad] of a joint that is held still and only yields to pushes.
_YIELDS = 4e-3


@dataclass(frozen=True)
class Source:
    """A cleaned recording, or piece of one, at the recording's rate.

    Attributes
    ----------
    run : Run
    faulty : ndarray (N, n) of bool
        Torques that are no measurements.
    lost : ndarray (N,) of bool
        Samples that were interpolated where the recorder lost some.
    body : RigidBody
    carries : bool
        Whether it carries a payload whose declared mass may be wrong.
    """

    run: Run
    faulty: np.ndarray
    lost: np.ndarray
    body: RigidBody
    carries: bool = True


@dataclass(frozen=True)
class MovingJoints:
    """Which joints move in the training runs, and how fast.

    Attributes
    ----------
    moving : ndarray (n,) of bool
    top_speed : ndarray (n,)
    """

    moving: np.ndarray
    top_speed: np.ndarray


def rigid_body_of(urdf: str, dataset: Dataset, payload: PayloadFields | None) -> RigidBody:
    """Rigid body of a data set's robot with a payload."""
    carried = None
    if payload is not None:
        x, y, z = payload.com
        carried = Payload(payload.mass, (x, y, z))
    return RigidBody(urdf, dataset.joints, tuple(dataset.fields.robot.gravity), carried)


def is_carried(dataset: Dataset, payload: PayloadFields | None) -> bool:
    """Whether a run with this payload, or None, would show an error of the declared payload.

    Where no run declares a payload, every run may carry something.
    """
    masses = [run.payload.mass for run in dataset.runs if run.payload is not None]
    return (payload is not None and payload.mass > 0.0) or not any(mass > 0.0 for mass in masses)


def widest_reach(dataset: Dataset) -> np.ndarray:
    """Largest span (n,) of each joint's position in the runs."""
    return np.max([record.reach for record in dataset.runs], axis=0)


def clean_runs(
    dataset: Dataset, urdf: str, notes: list[str], reach: np.ndarray | None = None
) -> list[Source]:
    """Read every recording, split it at its gaps, bring it to a uniform grid and clean it.

    Where only stretches of a recording are used, the rest is dropped.

    Parameters
    ----------
    dataset : Dataset
    urdf : str
    notes : list of str
        List to which notes on what was corrected are added.
    reach : ndarray (n,), optional
        Span of each joint's position in further runs; the larger span is used.
    """
    own = widest_reach(dataset)
    reach = own if reach is None else np.maximum(own, reach)
    sources = []
    for record in dataset.runs:
        made = clean_record(dataset, record, urdf, reach, notes)
        sources += made if record.stretches is None else _cut_stretches(made, record.stretches)
    return sources


def clean_record(
    dataset: Dataset, record: RunRecord, urdf: str, reach: np.ndarray, notes: list[str]
) -> list[Source]:
    """Cleaned pieces of one whole recording, as `clean_runs` makes them."""
    rate, where = dataset.fields.sample_rate, str(dataset.folder / record.file)
    pieces, told = split_at_gaps(_unwrap(dataset, record.load(), notes), rate, where)
    notes += told
    sources = []
    for piece in pieces:
        even, told = space_evenly(piece, rate)
        notes += told
        uniform = resample(even, rate)
        uniform.quantum = _share_quantum(dataset, uniform)
        cleaned = clean_run(uniform, dataset.joints, where, reach, dataset.accepted)
        notes += cleaned.notes
        lost = mark_losses(cleaned.run)
        body = rigid_body_of(urdf, dataset, cleaned.run.payload)
        _add_gravity(dataset, cleaned.run, body)
        sources.append(
            Source(cleaned.run, cleaned.faulty, lost, body, is_carried(dataset, cleaned.run.payload))
        )
    return sources


def _unwrap(dataset: Dataset, run: Run, notes: list[str]) -> Run:
    """Run with unwrapped angles; this comes before anything is interpolated between its samples."""
    q, wrapped = run.q.copy(), []
    for j, unit in enumerate(dataset.position_unit):
        if unit == "rad":
            q[:, j], jumps = unwrap_turns(run.q[:, j])
            wrapped += [f"q_{dataset.joints[j]}"] if jumps else []
    if wrapped:
        notes.append(f"{run.file}: {', '.join(wrapped)}: unwrapped where a full turn begins again.")
    return replace(run, q=q)


def _share_quantum(dataset: Dataset, run: Run) -> np.ndarray:
    """Step (n,) of each encoder; of a joint that rests, the largest step of joints with the same unit."""
    units = np.array(dataset.position_unit)
    known = np.max([record.quantum for record in dataset.runs], axis=0)
    quantum = known.copy() if run.quantum is None else run.quantum.copy()
    for j in range(len(quantum)):
        alike = known[units == units[j]].max()
        if np.ptp(run.q[:, j]) <= QUANTA * alike:
            quantum[j] = alike
    return quantum


def _add_gravity(dataset: Dataset, run: Run, body: RigidBody) -> None:
    """Add the stated body's gravity to the torques that are recorded without it."""
    without = [reading == "without_gravity" for reading in dataset.fields.readings().values()]
    if any(without) and any(body.gravity):
        still = np.zeros_like(run.q)
        run.tau[:, without] += body.inverse_dynamics(run.q, still, still)[:, without]


def _cut_stretches(sources: list[Source], stretches: tuple[tuple[float, float], ...]) -> list[Source]:
    """Pieces between given times; copies, so that the memory of the rest can be freed."""
    cut: list[Source] = []
    for source in sources:
        for start, stop in stretches:
            first, after = np.searchsorted(source.run.t, [start - 1e-9, stop - 1e-9]).tolist()
            t = source.run.t[first:after]
            if len(t) < LEAST_ROWS or t[-1] - t[0] < LEAST_TIME:
                continue
            run = replace(deepcopy(source.run.cut(first, after)), piece=len(cut) + 1)
            faulty, lost = source.faulty[first:after].copy(), source.lost[first:after].copy()
            cut.append(replace(source, run=run, faulty=faulty, lost=lost))
    return cut


def leave_out_rest(
    dataset: Dataset, sources: list[Source], notes: list[str]
) -> tuple[list[Source], MovingJoints]:
    """Sources in which the robot moves, and the joints that move in the training runs.

    Raises
    ------
    InputError
        Where nothing moves in any run of one use.
    """
    reach = [np.ptp(s.run.q, axis=0) for s in sources]
    largest = np.max([r for r, s in zip(reach, sources, strict=True) if s.run.use == "train"], axis=0)
    if largest.max() < _LEAST_MOTION:
        raise InputError(
            f"{dataset.folder}: no joint moves in any train run; give at least one train run with motion."
        )
    turns = np.array([unit == "rad" for unit in dataset.position_unit])
    if np.all(largest <= np.where(turns, _YIELDS, _LEAST_MOTION)):
        yields = 1000.0 * largest.max()
        raise InputError(
            f"{dataset.folder}: the robot stands still, its joints yield by {yields:.2g} mrad at most; "
            "nothing can be identified, give train runs with motion"
            f"{say_pushes(dataset, [source.run for source in sources])}."
        )
    furthest = np.array([r.max() for r in reach])
    usual = float(np.quantile(furthest[furthest >= _LEAST_MOTION], 0.75))
    kept = leave_out_still(sources, RESTS * usual, notes)
    for use in ("train", "test"):
        if not any(source.run.use == use for source in kept):
            raise InputError(
                f"{dataset.folder}: the robot stands still in every {use} run; give a {use} run with motion."
            )
    counted = np.array([reading != "none" for reading in dataset.fields.readings().values()])
    moving = largest > max(_LEAST_MOTION, RESTS * largest.max())
    for some, told in (
        (~counted, "torque does not count, as 'torque: none' says"),
        (counted & ~moving, "no motion in the train runs; friction there stays undetermined"),
    ):
        if some.any():
            named = ", ".join(np.array(dataset.joints)[some])
            notes.append(f"{named}: {told}.")
    return kept, MovingJoints(moving & counted, _find_top_speeds(kept, dataset.fields.sample_rate))


def leave_out_still(sources: list[Source], least: float, notes: list[str]) -> list[Source]:
    """Runs in which a joint travels `least` (rad or m) or more; the others are noted and left out."""
    kept = []
    for source in sources:
        if np.ptp(source.run.q, axis=0).max() < least:
            notes.append(f"{source.run.label}: the robot stands still; the run is left out.")
        else:
            kept.append(source)
    return kept


def _find_top_speeds(sources: list[Source], rate: float) -> np.ndarray:
    """Largest speed (n,) of each joint in the training runs, from positions a tenth of a second apart."""
    step = max(1, int(0.1 * rate))
    return np.max(
        [
            np.abs(s.run.q[step:] - s.run.q[:-step]).max(axis=0) * rate / step
            for s in sources
            if s.run.use == "train"
        ],
        axis=0,
    )
