"""Checks a measured data set: its fields, its recordings, and whether their values are plausible."""

from contextlib import suppress
from pathlib import Path

import numpy as np

from wearscope.closed_loop.intake.data_folder import find_inside
from wearscope.closed_loop.intake.dataset import list_run_problems, read_dataset
from wearscope.closed_loop.intake.dataset_fields import (
    DatasetFields,
    list_breaches,
    read_fields,
)
from wearscope.closed_loop.intake.field_checks import list_conflicts
from wearscope.closed_loop.intake.plausibility import check_plausibility
from wearscope.closed_loop.intake.table_files import read_columns, take_positions
from wearscope.closed_loop.intake.thinning import prepare_thinned
from wearscope.closed_loop.intake.threads import keep_to_one_thread
from wearscope.closed_loop.posing import find_prismatic, load_named_effects
from wearscope.errors import Findings, InputError
from wearscope.storage.files import check_plain
from wearscope.tracking.session_names import read_sessions
from wearscope.tracking.session_runs import check_sessions


@keep_to_one_thread
def check_dataset(path: str | Path, allow_code: bool = False) -> Findings:
    """Check whether a data set can be diagnosed, without diagnosing it.

    Parameters
    ----------
    path : path-like
        The data set's folder or ``dataset.yaml``.
    allow_code : bool
        Whether effects in Python files that the data set names may be loaded.

    Returns
    -------
    Findings
        Problems and notes.
    """
    path = Path(path)
    folder = path.parent if path.suffix in (".yaml", ".yml") else path
    file = folder / "dataset.yaml"
    found = Findings(f"data set {folder}")
    breaches = found.attempt(lambda: list_breaches(file))
    found.add(*(breaches or ()))
    if found.problems:
        return found
    fields = found.attempt(lambda: read_fields(file, found.notes))
    if fields is None:
        return found
    found.add(*list_conflicts(file, fields))
    urdf = found.attempt(lambda: find_inside(folder, fields.robot.urdf, f"{file}: robot.urdf"))
    if urdf is not None and found.attempt(lambda: _is_file(urdf)):
        found.attempt(lambda: find_prismatic(urdf, fields.robot.joints))
    found.add(*list_run_problems(folder, fields), *_list_resting(folder, fields))
    if found.problems:
        return found
    found.notes.clear()
    if not any(fields.robot.gravity):
        found.notes.append(f"{file}: robot.gravity is 0; where the machine is not in orbit, give m/s^2.")
    dataset = found.attempt(lambda: read_dataset(folder, find_prismatic))
    if dataset is None:
        return found
    found.attempt(lambda: load_named_effects(dataset, (), allow_code))
    prepared = found.attempt(lambda: prepare_thinned(dataset))
    if prepared is not None:
        found.attempt(lambda: check_plausibility(prepared))
        found.notes += prepared.notes
    if fields.reference and not found.problems:
        found.attempt(lambda: check_sessions(read_sessions(file)))
    return found


def _list_resting(folder: Path, fields: DatasetFields) -> list[str]:
    """Return a sentence for each recording in which no joint moves."""
    resting = []
    for run in fields.runs:
        with suppress(InputError):  # `list_run_problems` reports missing and unreadable files
            path = find_inside(folder, run.file, "runs[].file")
            if not np.ptp(take_positions(path, read_columns(path), fields.robot.joints), axis=0).any():
                resting.append(f"{path}: is constant, no joint moves in it; record it again or leave it out.")
    return resting


def _is_file(path: Path) -> bool:
    """Return True for a readable file; raise InputError otherwise."""
    check_plain(path, np.inf, "correct robot.urdf in dataset.yaml")
    return True
