"""Further runs of a machine made ready as the runs of a reference were: nothing is chosen from them."""

from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.intake.dataset import Dataset
from wearscope.closed_loop.intake.direction import Reversals
from wearscope.closed_loop.intake.filtering import Band, choose_factor
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun, known_inertia
from wearscope.closed_loop.intake.preprocessing import bridge_gaps, finish_run, leave_out_short, make_rough
from wearscope.closed_loop.intake.sources import RESTS, MovingJoints, clean_runs
from wearscope.errors import InputError


@dataclass(frozen=True)
class Frame:
    """What the preparation chose on the reference.

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
        reach = np.max([record.reach for record in prepared.dataset.runs], axis=0)
        return cls(
            prepared.urdf, prepared.band, prepared.moving, prepared.top_speed, prepared.reversals, reach
        )


def prepare_runs(dataset: Dataset, frame: Frame) -> tuple[list[PreparedRun], list[str]]:
    """Runs of a data set in a frame, and notes; those in which the machine stands still are left out.

    Parameters
    ----------
    dataset : Dataset
        Of these runs only; all of them have the use ``train``.
    frame : Frame

    Raises
    ------
    InputError
        Where the machine stands still in all of them, or a channel is broken beyond correction.
    """
    notes = list(dataset.notes)
    sources = clean_runs(dataset, frame.urdf, notes, frame.reach)
    moves = [s for s in sources if np.ptp(s.run.q, axis=0).max() >= RESTS * frame.reach.max()]
    notes += [
        f"{s.run.label}: the robot stands still; the run is left out."
        for s in sources
        if not any(s is m for m in moves)
    ]
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
