"""Writes a generated data set's folder; nothing that tells the truth goes into it."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.board.disturbances import jitter_times, make_noise
from benchmarks.board.physics import Behaviour, Setting
from benchmarks.board.recipe import Recipe, make_stream
from wearscope.demonstration.motions import Machine
from wearscope.demonstration.twin import quantise
from wearscope.storage.tables import write_table, write_text

Array = NDArray[np.float64]


def _miss_inertials(urdf: str, error: float, rng: np.random.Generator) -> str:
    """URDF text with every link's mass and inertia off by one factor a link (so they stay consistent)."""

    def link(match: re.Match[str]) -> str:
        factor = float(np.exp(error * rng.normal()))

        def scaled(number: re.Match[str]) -> str:
            return f'{number[1]}="{float(number[2]) * factor:.6g}"'

        return re.sub(r'(value|i[xyz][xyz])="([^"]*)"', scaled, match[0])

    return re.sub(r"<inertial>.*?</inertial>", link, urdf)


def _one_or_all(units: list[str]) -> str | list[str]:
    return units[0] if len(set(units)) == 1 else units


def record_run(
    machine: Machine, recipe: Recipe, behaviour: Behaviour, sigma: Array, rng: np.random.Generator,
    with_temperature: bool, acted: Array | None = None,
) -> tuple[dict[str, Array], dict[str, str], dict[str, Array]]:  # fmt: skip
    """Columns of a run, their units, and its `clean`, `noise`, `effect` and `position` (N, n).

    `acted` (N, n) is the torque disturbance where it has acted already inside a position loop.
    """
    b, every = behaviour, slice(None, None, recipe.oversampling)
    t = b.t[every]
    at_q, at_tau = jitter_times(t, recipe.noise, recipe.rate, rng)
    noise = acted
    if noise is None:
        noise = make_noise(recipe.noise, len(t), sigma, recipe.rate, rng, recipe.memory, recipe.frequency)
    q = np.column_stack([np.interp(at_q, b.t, column) for column in b.q.T])
    clean = np.column_stack([np.interp(at_tau, b.t, column) for column in b.tau.T])
    resolution = 2 * np.pi / (2**17 * np.asarray(machine.gear_ratio))
    if recipe.encoder_step is not None:
        resolution = recipe.encoder_step * np.asarray(machine.reach)
    q = quantise(q, resolution, rng)
    columns, units = {"t": t}, {"t": "s"}
    for j, joint in enumerate(machine.joints):
        columns[f"q_{joint}"], columns[f"tau_{joint}"] = q[:, j], clean[:, j] + noise[:, j]
        units[f"q_{joint}"], units[f"tau_{joint}"] = machine.position_unit(j), machine.torque_unit(j)
        if with_temperature:
            columns[f"temp_{joint}"] = np.round(b.temperature[every, j], 1)
            units[f"temp_{joint}"] = "degC"
    return columns, units, {"clean": clean, "noise": noise, "effect": b.plant_torque[every], "position": q}


def list_run(file: str, use: str, machine: Machine, loaded: bool = True) -> dict[str, Any]:
    """Entry of a run in ``dataset.yaml``."""
    entry: dict[str, Any] = {"file": file, "use": use}
    if machine.payload_mass > 0 and loaded:
        entry["payload"] = {"mass": machine.payload_mass, "com": list(machine.payload_com)}
    return entry


def write_folder(
    folder: Path, machine: Machine, setting: Setting, recipe: Recipe, behaviours: list[Behaviour],
    noises: list[Array | None], sigma: Array, seed: int, declared: list[str], with_temperature: bool,
) -> dict[str, Array]:  # fmt: skip
    """Write ``dataset.yaml``, ``robot.urdf`` and the runs; sensor errors are drawn here, by run.

    `noises` holds a run's torque disturbance (N, n) where it has acted already inside a position loop, else
    None.

    Returns
    -------
    dict
        Columns to be sealed: `run`, `t`, and by joint `clean_`, `noise_` and `effect_` torque, and
        `position_` as recorded.
    """
    joints, n = machine.joints, len(machine.joints)
    sealed: dict[str, list[Array]] = {"run": [], "t": []}
    listing: list[dict[str, Any]] = []
    for number, (plan, behaviour, acted) in enumerate(zip(recipe.plans, behaviours, noises, strict=True)):
        rng = make_stream(seed, machine.name, "noise", str(number))
        columns, units, kept = record_run(machine, recipe, behaviour, sigma, rng, with_temperature, acted)
        sealed["run"].append(np.full(len(columns["t"]), number, dtype=float))
        sealed["t"].append(columns["t"])
        for j, joint in enumerate(joints):
            for key, value in kept.items():
                sealed.setdefault(f"{key}_{joint}", []).append(value[:, j])
        file = f"runs/r{number + 1}.parquet"
        write_table(folder / file, columns, units)
        listing.append(list_run(file, plan.use, machine))
    approximate = bool(recipe.inertia_error) if recipe.approximate is None else recipe.approximate
    robot: dict[str, Any] = {
        "urdf": "robot.urdf",
        "joints": list(joints),
        "inertials": "approximate" if approximate else "trusted",
        "gravity": list(machine.gravity),
        "gear_ratio": list(machine.gear_ratio),
    }
    if "rotor_inertia" in declared and recipe.rotor_given:
        robot["rotor_inertia"] = setting.rotor.tolist()
    document = {
        "name": folder.name,
        "description": f"{len(joints)}-joint machine, recorded on {len(behaviours)} runs.",
        "source": "generated",
        "robot": robot,
        "sample_rate": recipe.rate,
        "units": {
            "q": _one_or_all([machine.position_unit(j) for j in range(n)]),
            "tau": _one_or_all([machine.torque_unit(j) for j in range(n)]),
        },
        "declared_effects": declared,
        "runs": listing,
    }
    rng = make_stream(seed, machine.name, "inertials")
    urdf = _miss_inertials(machine.urdf, recipe.inertia_error, rng) if recipe.inertia_error else machine.urdf
    write_text(folder / "robot.urdf", urdf)
    write_text(folder / "dataset.yaml", yaml.safe_dump(document, sort_keys=False))
    return {key: np.concatenate(parts) for key, parts in sealed.items()}
