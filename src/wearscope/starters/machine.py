"""Writes the example data set that ships with the package, and an example to try the commands on.

``python -m wearscope.starters.machine`` simulates a machine of three joints and writes its recordings to
``src/wearscope/example_data``; a test makes them again and compares.

The example to try the commands on holds a robot's URDF, as its maker would give it, and recordings in text
files, as a drive's recorder would write them.
"""

import shutil
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from wearscope.checking.own_code import make_batch
from wearscope.cycles.base import load_cycle
from wearscope.home import example_dataset, find_home
from wearscope.robots.model import RobotModel, load_model
from wearscope.robots.spatial import Array
from wearscope.simulation.recording import Recording
from wearscope.simulation.sensors import seed_of
from wearscope.simulation.study import simulate_point
from wearscope.starters.mapped import DECLARED
from wearscope.starters.writing import new_folder
from wearscope.storage import tables
from wearscope.storage.files import copy_file

JOINTS = 3
#: Sample rate of the recordings [Hz], and step of the simulation [s].
RATE, STEP = 125.0, 0.004
SEED = 17
#: File, test-cycle and use of each run.
RUNS = (
    ("excitation", "periodic_excitation", "train"),
    ("reversals", "slow_reversals", "train"),
    ("transfer", "point_to_point", "train"),
    ("sweeps", "axis_sweeps", "test"),
)
#: Friction of the declared model, which the controller uses [N m, N m s/rad].
COULOMB, VISCOUS = (42.0, 105.0, 42.0), (15.0, 55.0, 9.0)


@dataclass(frozen=True)
class Planted:
    """An effect that the simulated machine has and its declared model lacks."""

    joint: str
    effect: str
    parameters: dict[str, float]


#: A balancer at joint 2 [N m], and Stribeck friction, which falls with speed after break-away, at joint 3.
PLANTED = (
    Planted("axis_2", "gravity_counterbalance", {"sine1": -320.0, "cosine1": 0.0}),
    Planted("axis_3", "stribeck", {"level": 25.0, "speed": 0.15, "exponent": 1.0}),
)


def make_machine() -> RobotModel:
    """Return the medium robot's first three joints, with Coulomb and viscous friction and planted effects."""
    whole = load_model("medium").to_mapping()
    drive = {name: values[:JOINTS] for name, values in whole["drive"].items()}
    sensors = whole["sensors"]
    sensors |= {name: sensors[name][:JOINTS] for name in ("encoder_resolution", "torque_noise")}
    joints = whole["joints"][:JOINTS]
    effects = [
        *(
            {"joint": joint, "effect": effect, "parameters": {name: value}}
            for effect, name, values in (("coulomb", "level", COULOMB), ("viscous", "slope", VISCOUS))
            for joint, value in zip(joints, values, strict=True)
        ),
        *map(asdict, PLANTED),
    ]
    return load_model("medium").replace(
        name="example-arm", joints=joints, drive=drive, sensors=sensors, payload=None,
        home=whole["home"][:JOINTS], wear_axes=joints, effects=effects,
    )  # fmt: skip


def make_runs(model: RobotModel) -> dict[str, Recording]:
    """Simulate the runs; return recording by run."""
    return {
        name: simulate_point(
            model, load_cycle(cycle).build(model, 0.05, STEP), seed=seed_of(SEED, name), sample_rate=RATE
        )
        for name, cycle, _ in RUNS
    }


def write_machine(target: Path) -> None:
    """Write the folder of the example data set.

    Raises
    ------
    InputError
        Where the folder exists already.
    """
    model = make_machine()
    with new_folder(target) as folder:
        copy_file(find_home() / "config" / "robots" / "medium" / "robot.urdf", folder / "robot.urdf")
        (folder / "runs").mkdir()
        for name, run in make_runs(model).items():
            columns, units = {"t": run.t}, {"t": "s"}
            for k, joint in enumerate(model.joints):
                columns |= {f"q_{joint}": run.q[:, k], f"tau_{joint}": run.tau[:, k].astype(np.float32)}
                units |= {f"q_{joint}": "rad", f"tau_{joint}": "N m"}
            tables.write_table(folder / "runs" / f"{name}.parquet", columns, units)
        fields = {
            "name": "example-arm",
            "description": "An arm of three joints, simulated; two of them have what its model lacks.",
            "source": "python -m wearscope.starters.machine",
            "robot": {
                "urdf": "robot.urdf",
                "joints": model.joints,
                "gear_ratio": model.drive.gear_ratio,
                "rotor_inertia": model.drive.rotor_inertia,
            },
            "sample_rate": RATE,
            "declared_effects": list(DECLARED),
            "runs": [{"file": f"runs/{name}.parquet", "use": use} for name, _, use in RUNS],
        }
        (folder / "dataset.yaml").write_text(yaml.safe_dump(fields, sort_keys=False), encoding="utf-8")


if __name__ == "__main__":
    place = Path(sys.argv[1]) if len(sys.argv) > 1 else example_dataset()
    shutil.rmtree(place, ignore_errors=True)
    write_machine(place)


#: Test-cycle of the recording of each day.
DAYS = {
    "monday": "point_to_point",
    "tuesday": "axis_sweeps",
    "wednesday": "slow_reversals",
    "thursday": "spot_welding",
}
#: Motion of the later sessions.
CYCLE = "point_to_point"
#: Wear of the second axis in the session `worn` [-], and mass of the undeclared tool in the session `tool`
#: [kg].
WEAR, TOOL = 40.0, 6.0
#: Decimals that the recorder writes, of degrees and of N m.
_DIGITS = 4


def write_example(target: Path) -> None:
    """Write the medium robot as ``arm.urdf``, and recordings of it in ms, degrees and N m, separated by ';'.

    There is one recording for each of four healthy days. The folder ``later/`` has two more healthy days,
    from which detectors learn how the motion scatters, and three sessions: ``unchanged``; ``worn``, with a
    worn second axis; and ``tool``, with an undeclared tool. The folder ``machine/`` is a copy of the data set
    that ships with the package. The torque is that of the robot's model at 50 deg C, including friction by
    eq. (17), with sensor noise.

    Raises
    ------
    InputError
        Where the folder exists already.
    """
    model = load_model("medium").replace(payload=None)
    axis = model.wearing([2])
    carrying = model.replace(payload={"mass": TOOL, "com": [0.05, 0.0, 0.1]})
    sessions = {
        **dict.fromkeys(("friday", "saturday", "unchanged"), (model, 0.0)),
        "worn": (axis, WEAR),
        "tool": (carrying, 0.0),
    }
    with new_folder(target) as folder:
        shutil.copytree(example_dataset(), folder / "machine", copy_function=copy_file)
        copy_file(find_home() / "config" / "robots" / "medium" / "robot.urdf", folder / "arm.urdf")
        for seed, (day, cycle) in enumerate(DAYS.items()):
            _write_recording(folder / f"{day}.csv", model, cycle, 0.0, seed)
        (folder / "later").mkdir()
        for seed, (name, (machine, wear)) in enumerate(sessions.items(), start=len(DAYS)):
            _write_recording(folder / "later" / f"{name}.csv", machine, CYCLE, wear, seed)


def _write_recording(file: Path, model: RobotModel, cycle: str, wear: float, seed: int) -> None:
    """Simulate a recording and write it as a drive's recorder would."""
    batch = make_batch(model, cycle, wear, seed)
    columns: dict[str, Array] = {
        "time [ms]": (1e3 * batch.t).round(3),
        **{f"actual_q_{k}": one.round(_DIGITS) for k, one in enumerate(np.degrees(batch.q.T))},
        **{f"actual_torque_{k}": one.round(_DIGITS) for k, one in enumerate(batch.tau.T)},
    }
    pd.DataFrame(columns).to_csv(file, sep=";", index=False)
