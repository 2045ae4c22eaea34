"""The recordings of a data set's sessions."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from wearscope.closed_loop.intake.dataset import Dataset, read_dataset
from wearscope.closed_loop.intake.dataset_fields import DatasetFields, RunFields
from wearscope.closed_loop.intake.plausibility import check_plausibility
from wearscope.closed_loop.intake.thinning import prepare_thinned
from wearscope.closed_loop.posing import find_prismatic
from wearscope.tracking.session_names import Sessions
from wearscope.tracking.session_runs import Frame, prepare_runs


def check_sessions(sessions: Sessions) -> None:
    """Refuse sessions that tracking would refuse after the healthy machine is identified.

    Raises
    ------
    InputError
        Where the reference cannot be what it says, or the robot stands still in a later session.
    """
    prepared = prepare_thinned(read_reference(sessions))
    check_plausibility(prepared)
    for session in sessions.later:
        prepare_runs(read_session(sessions, session), Frame.of(prepared))


def _read(folder: Path, choose: Callable[[DatasetFields], list[RunFields]]) -> Dataset:
    return read_dataset(folder, find_prismatic, choose)


def read_reference(sessions: Sessions) -> Dataset:
    """The reference's runs; where none is a test run, the last training run is scored as one too.

    A structure that is fixed needs no verdict from the test runs; the closed loop asks for one all the same.
    """

    def choose(fields: DatasetFields) -> list[RunFields]:
        return [run for run in fields.runs if run.session in sessions.reference]

    dataset = _read(sessions.folder, choose)
    if not dataset.runs_for("test"):
        last = dataset.runs_for("train")[-1]
        dataset.runs.append(replace(last, use="test", load=lambda: replace(last.load(), use="test")))
    return dataset


def read_session(sessions: Sessions, session: str) -> Dataset:
    """Runs of one session, whatever their use: what is tracked is only ever compared with the reference."""

    def choose(fields: DatasetFields) -> list[RunFields]:
        own = [run for run in fields.runs if run.session == session]
        return [run.model_copy(update={"use": "train"}) for run in own]

    return _read(sessions.folder, choose)
