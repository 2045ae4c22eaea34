"""Further runs of a case that was recorded already: the same machine along a motion that is given."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.board.disturbances import make_noise
from benchmarks.board.generate import (
    Recording,
    declare_effects,
    plant_effects,
    record,
    warm_up,
)
from benchmarks.board.machines import Body
from benchmarks.board.physics import Active, Structural, behave
from benchmarks.board.recipe import RunPlan, make_stream
from benchmarks.board.regimes import Case
from wearscope.demonstration.motions import Motion
from wearscope.demonstration.twin import quantise
from wearscope.storage.tables import write_table, write_text

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Further:
    """A run to record.

    Attributes
    ----------
    motion : Motion
        On the case's fine grid.
    loaded : bool
        Whether the machine carries its payload.
    temperature : float or None
        At the start [deg C]; 35 where None.
    """

    motion: Motion
    loaded: bool = True
    temperature: float | None = None


def record_further(folder: Path, case: Case, runs: Sequence[Further]) -> list[str]:
    """Add training runs to a case's data set and return their files.

    The machine, its plants and the torque noise are those of the case, and so are the data set's other runs.
    """
    recipe, machine, seed = case.recipe, case.machine, case.seed
    recording = record(machine, seed, recipe, declare_effects(recipe, case.planted), case.planted)
    actives, _ = plant_effects(recording, case.planted, seed)
    document = yaml.safe_load((folder / "dataset.yaml").read_text(encoding="utf-8"))
    warm = any("temp_" in name for name in _column_names(folder, document))
    files = []
    for number, run in enumerate(runs):
        rng = make_stream(seed, machine.name, "further", str(number))
        file = f"runs/further{number + 1}.parquet"
        write_table(folder / file, _record_one(recording, actives, run, warm, rng))
        entry: dict[str, Any] = {"file": file, "use": "train"}
        if machine.payload_mass > 0 and run.loaded:
            entry["payload"] = {"mass": machine.payload_mass, "com": list(machine.payload_com)}
        document["runs"].append(entry)
        files.append(file)
    write_text(folder / "dataset.yaml", yaml.safe_dump(document, sort_keys=False))
    return files


def _column_names(folder: Path, document: dict[str, Any]) -> list[str]:
    import pyarrow.parquet as pq

    return list(pq.read_schema(folder / document["runs"][0]["file"]).names)


def _record_one(
    recording: Recording, actives: list[Active], run: Further, warm: bool, rng: np.random.Generator
) -> dict[str, Array]:
    recipe, setting = recording.recipe, recording.setting
    machine, n, motion = setting.machine, len(setting.machine.joints), run.motion
    body = recording.body
    if not run.loaded:
        # Without its payload the machine has no error of it either.
        setting = replace(setting, machine=replace(machine, payload_mass=0.0))
        body = Body(machine.urdf, machine.gravity, 0.0, (0.0, 0.0, 0.0))
        actives = [
            a for a in actives if not (isinstance(a.plant, Structural) and a.plant.kind == "payload_error")
        ]
    start = 35.0 if run.temperature is None else run.temperature
    temperature = warm_up(RunPlan("train", "given", -1, start), n, motion.t, rng)
    b = behave(setting, motion, temperature, actives, body)
    every = slice(None, None, recipe.oversampling)
    t = b.t[every]
    noise = make_noise(
        recipe.noise, len(t), recording.sigma, recipe.rate, rng, recipe.memory, recipe.frequency
    )
    if recipe.encoder_step is None:
        resolution = 2 * np.pi / (2**17 * np.asarray(machine.gear_ratio))
    else:
        resolution = recipe.encoder_step * np.asarray(machine.reach)
    q, tau = quantise(b.q[every], resolution, rng), b.tau[every] + noise
    columns: dict[str, Array] = {"t": t}
    for j, joint in enumerate(machine.joints):
        columns[f"q_{joint}"], columns[f"tau_{joint}"] = q[:, j], tau[:, j]
        if warm:
            columns[f"temp_{joint}"] = np.round(temperature[every, j], 1)
    return columns
