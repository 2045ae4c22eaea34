"""A robot's URDF and recordings of it to try things on, as a maker and a drive's recorder would give them."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd

from wearscope.checking.own_code import make_batch
from wearscope.home import example_dataset, find_home
from wearscope.robots.model import RobotModel, load_model
from wearscope.robots.spatial import Array
from wearscope.starters.writing import new_folder
from wearscope.storage.files import copy_file

#: Test-cycle by day of recording.
DAYS = {
    "monday": "point_to_point",
    "tuesday": "axis_sweeps",
    "wednesday": "slow_reversals",
    "thursday": "spot_welding",
}
#: Motion of the later sessions.
CYCLE = "point_to_point"
#: Wear of the second axis in the session `worn`, and the tool that nobody declared [kg].
WEAR, TOOL = 40.0, 6.0
#: Digits of the recorder: degrees and N m.
_DIGITS = 4


def write_example(target: Path) -> None:
    """Write ``arm.urdf``, the medium robot's, and recordings of it: ms, degrees, N m, separated by ';'.

    One a day of a healthy week. In ``later/`` two more healthy days, from which detectors learn how the
    motion scatters, and three sessions: ``unchanged``; ``worn``, with a worn second axis; ``tool``, with a
    tool that nobody declared. The data set that ships with the package goes to ``machine/``. The torque is
    that of the robot's model at 50 deg C, friction by eq. (17) included, with sensor noise.

    Raises
    ------
    InputError
        Where the folder is there already.
    """
    model = load_model("medium").replace(payload=None)
    axis = model.wearing([2])
    carrying = model.replace(payload={"mass": TOOL, "com": [0.05, 0.0, 0.1]})
    sessions = dict.fromkeys(("friday", "saturday", "unchanged"), (model, 0.0))
    sessions |= {"worn": (axis, WEAR), "tool": (carrying, 0.0)}
    with new_folder(target) as folder:
        shutil.copytree(example_dataset(), folder / "machine", copy_function=copy_file)
        copy_file(find_home() / "config" / "robots" / "medium" / "robot.urdf", folder / "arm.urdf")
        for seed, (day, cycle) in enumerate(DAYS.items()):
            _write_recording(folder / f"{day}.csv", model, cycle, 0.0, seed)
        (folder / "later").mkdir()
        for seed, (name, (machine, wear)) in enumerate(sessions.items(), start=len(DAYS)):
            _write_recording(folder / "later" / f"{name}.csv", machine, CYCLE, wear, seed)


def _write_recording(file: Path, model: RobotModel, cycle: str, wear: float, seed: int) -> None:
    """A recording as a drive's recorder writes it."""
    batch = make_batch(model, cycle, wear, seed)
    columns: dict[str, Array] = {"time [ms]": (1e3 * batch.t).round(3)}
    for k in range(model.n):
        columns[f"actual_q_{k}"] = np.degrees(batch.q[:, k]).round(_DIGITS)
    for k in range(model.n):
        columns[f"actual_torque_{k}"] = batch.tau[:, k].round(_DIGITS)
    pd.DataFrame(columns).to_csv(file, sep=";", index=False)
