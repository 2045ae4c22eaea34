"""Recordings of sessions, prepared with the filters and widths that were chosen on the reference."""

from dataclasses import dataclass, replace

import numpy as np

from wearscope.closed_loop.intake.dataset import Dataset, read_dataset
from wearscope.closed_loop.intake.dataset_fields import DatasetFields, RunFields
from wearscope.closed_loop.intake.direction import Reversals
from wearscope.closed_loop.intake.filtering import Band, choose_factor
from wearscope.closed_loop.intake.plausibility import check_plausibility
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun, known_inertia
from wearscope.closed_loop.intake.preprocessing import bridge_gaps, finish_run, leave_out_short, make_rough
from wearscope.closed_loop.intake.sources import (
    RESTS,
    MovingJoints,
    clean_runs,
    leave_out_still,
    widest_reach,
)
from wearscope.closed_loop.intake.thinning import prepare_thinned
from wearscope.closed_loop.posing import find_prismatic
from wearscope.errors import InputError
from wearscope.tracking.session_names import Sessions


@dataclass(frozen=True)
class Frame:
    """Robot, filters and reversals that the preparation chose on the reference.

    Attributes
    ----------
    urdf : str
        Normalised URDF.
    band : Band
    moving : ndarray (n,) of bool
    top_speed : ndarray (n,)
    reversals : Reversals
    reach : ndarray (n,)
        Largest span of each joint's position in the reference's runs.
    """

    urdf: str
    band: Band
    moving: np.ndarray
    top_speed: np.ndarray
    reversals: Reversals
    reach: np.ndarray

    @classmethod
    def of(cls, prepared: Prepared) -> "Frame":
        """Frame of a prepared data set."""
        return cls(
            prepared.urdf, prepared.band, prepared.moving, prepared.top_speed, prepared.reversals,
            widest_reach(prepared.dataset),
        )  # fmt: skip


def prepare_runs(dataset: Dataset, frame: Frame) -> tuple[list[PreparedRun], list[str]]:
    """Runs of a data set prepared with a frame, and notes; runs without motion are left out.

    Parameters
    ----------
    dataset : Dataset
        Data set of these runs only; all of them have the use ``train``.
    frame : Frame

    Raises
    ------
    InputError
        Where the machine stands still in all of them, or a channel is broken beyond correction.
    """
    notes = list(dataset.notes)
    sources = clean_runs(dataset, frame.urdf, notes, frame.reach)
    moves = leave_out_still(sources, RESTS * frame.reach.max(), notes)
    if not moves:
        files = ", ".join(run.file for run in dataset.runs)
        raise InputError(f"{dataset.folder}: the robot stands still in {files}; record it in motion.")
    rate, inertia = dataset.fields.sample_rate, known_inertia(dataset)
    motion = MovingJoints(frame.moving, frame.top_speed)
    coarse = choose_factor(rate, frame.band.motion, 0.0)
    rough = [make_rough(s, rate, frame.band.motion, coarse, inertia, motion) for s in moves]
    moves, _ = bridge_gaps(dataset, moves, rough, coarse, notes)
    factor = round(rate / frame.band.rate)
    runs = [finish_run(s, rate, frame.band, factor, inertia, frame.reversals, motion) for s in moves]
    return leave_out_short(dataset, runs, frame.band, notes), notes


def check_sessions(sessions: Sessions) -> None:
    """Refuse sessions that tracking would refuse only after the healthy machine is identified.

    Raises
    ------
    InputError
        Where the reference's columns hold something else than stated, or a later session has no motion.
    """
    prepared = prepare_thinned(read_reference(sessions))
    check_plausibility(prepared)
    for session in sessions.later:
        prepare_runs(read_session(sessions, session), Frame.of(prepared))


def read_reference(sessions: Sessions) -> Dataset:
    """The reference's runs; where none is a test run, the last training run is used as one too.

    Tracking needs no verdict from test runs, but the closed loop requires one.
    """

    def choose(fields: DatasetFields) -> list[RunFields]:
        return [run for run in fields.runs if run.session in sessions.reference]

    dataset = read_dataset(sessions.folder, find_prismatic, choose)
    if not dataset.runs_for("test"):
        last = dataset.runs_for("train")[-1]
        dataset.runs.append(replace(last, use="test", load=lambda: replace(last.load(), use="test")))
    return dataset


def read_session(sessions: Sessions, session: str) -> Dataset:
    """Runs of one session, all as training runs, since they are only compared with the reference."""

    def choose(fields: DatasetFields) -> list[RunFields]:
        own = [run for run in fields.runs if run.session == session]
        return [run.model_copy(update={"use": "train"}) for run in own]

    return read_dataset(sessions.folder, find_prismatic, choose)
