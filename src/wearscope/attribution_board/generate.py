"""Makes measured-data folders with planted truth, and seals the truth outside of them."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wearscope.attribution_board.disturbances import check_noise
from wearscope.attribution_board.features import Families, make_track
from wearscope.attribution_board.folder import write_folder
from wearscope.attribution_board.machines import Body, Machine, find_machine
from wearscope.attribution_board.motions import Motion, make_motion
from wearscope.attribution_board.outside import OUTSIDE
from wearscope.attribution_board.physics import (
    Active,
    Setting,
    Structural,
    behave,
    first_amplitude,
    make_plant,
)
from wearscope.attribution_board.recipe import OVERSAMPLING, Planted, Recipe, RunPlan, make_stream
from wearscope.attribution_board.separability import (
    ONE_COEFFICIENT,
    UNABSORBED,
    accepted_names,
    judge_separability,
    project_parameter,
)
from wearscope.attribution_board.terms import Term
from wearscope.errors import InputError
from wearscope.tables import write_table, write_text

Array = NDArray[np.float64]

LACKING = {"rotor_inertia_error": "rotor_inertia", "coulomb": "coulomb", "viscous": "viscous"}
"""Effects that are planted by leaving a declared one out: no other joint of that machine has it."""
THERMAL = ("temperature_dependent_friction",)


def _setting(machine: Machine, seed: int, planted: Sequence[Planted]) -> Setting:
    rng = make_stream(seed, machine.name, "setting")
    n = len(machine.joints)
    lacking = {LACKING[p.effect] for p in planted if p.effect in LACKING}
    values = {
        "coulomb": np.asarray(machine.coulomb) * rng.uniform(0.8, 1.2, n),
        "viscous": np.asarray(machine.viscous) * rng.uniform(0.8, 1.2, n),
        "rotor_inertia": np.asarray(machine.rotor_inertia),
    }
    for name in lacking:
        values[name] = np.zeros(n)
    grain = np.asarray(machine.speed) * rng.uniform(0.0002, 0.001, n)
    return Setting(machine, values["coulomb"], values["viscous"], values["rotor_inertia"], grain)


def _temperature(plan: RunPlan, n: int, t: Array, rng: np.random.Generator) -> Array:
    """Joints warming from their start towards a balance of their own (N, n)."""
    start = plan.start_temperature + rng.uniform(-1.5, 1.5, n)
    rise, time = rng.uniform(2.0, 6.0, n), rng.uniform(15.0, 40.0, n)
    return start + rise * (1 - np.exp(-t[:, None] / time))


def _scale(
    plant: Term | Structural, wanted: float, sigma: Array, runs: list[tuple[Motion, Array]], setting: Setting,
    body: Body,
) -> tuple[float, int]:  # fmt: skip
    """Amplitude at which the plant's torque RMS is `wanted` noise RMS on the training runs, and its joint.

    The payload's error acts on all joints: it is measured at the joint where it stands out most.
    """
    amplitude = first_amplitude(plant, setting.machine)
    joint = plant.joint
    below, above = 0.0, np.inf
    for _ in range(25):
        active = [Active(plant, amplitude)]
        torque = np.vstack(
            [behave(setting, m, temp, active, body).plant_torque[::OVERSAMPLING] for m, temp in runs]
        )
        ratio = np.sqrt(np.mean(torque**2, axis=0)) / sigma
        if isinstance(plant, Structural) and plant.kind == "payload_error":
            joint = int(np.argmax(ratio))
        if not np.isfinite(ratio[joint]) or ratio[joint] < 1e-9:
            raise InputError(
                f"attribution board: the effect planted on {setting.machine.joints[joint]} makes no torque "
                "on these runs; plant it on a joint whose motion excites it."
            )
        if abs(ratio[joint] / wanted - 1) < 0.005:
            break
        size, sign = abs(amplitude), np.sign(amplitude)
        below, above = (size, above) if ratio[joint] < wanted else (below, size)
        size *= float(np.clip(wanted / ratio[joint], 0.05, 20.0))
        if not below < size < above:
            size = 0.5 * (below + above)
        amplitude = float(sign * size)
    return amplitude, joint


def generate_dataset(
    folder: str | Path,
    robot: str,
    planted: Sequence[Planted],
    seed: int,
    recipe: Recipe | None = None,
    truth_path: str | Path | None = None,
) -> dict[str, Any]:
    """Write a measured-data folder with planted effects; the truth stays out of it.

    Parameters
    ----------
    folder : path-like
        The data set's folder; its last part is the data set's name, which must not tell the truth.
    robot : str
        A machine of `machines.MACHINES`.
    planted : sequence of Planted
        Empty for a null.
    seed : int
    recipe : Recipe, optional
    truth_path : path-like, optional
        Where the truth is sealed as JSON; beside it, ``<stem>.signals.parquet`` holds the noiseless torque
        (`clean_<joint>`), the noise (`noise_<joint>`) and the plants' torque (`effect_<joint>`) by run.

    Returns
    -------
    dict
        `dataset`, `robot`, `seed`, `joints`, `unit`, `noise`, `noise_rms` (by joint), `planted` (a list with
        `effect`, `accepted`, `joint`, `joints`, `outside`, `size`, `measured_size`, `unabsorbed_size`,
        `separable`, `rivals`, `parameters`, `form`) and `signals` (a mapping of columns; not in the JSON).

    Raises
    ------
    InputError
        For an unknown machine, joint, effect or noise, or an effect that these motions do not excite.
    """
    recipe = recipe or Recipe()
    check_noise(recipe.noise)
    machine = find_machine(robot)
    for plant in planted:
        if plant.joint not in machine.joints:
            raise InputError(
                f"attribution board: {robot} has no joint '{plant.joint}'; choose one of "
                f"{', '.join(machine.joints)}."
            )
    setting = _setting(machine, seed, planted)
    body = Body(machine.urdf, machine.gravity, machine.payload_mass, machine.payload_com)
    fine = recipe.rate * OVERSAMPLING
    runs: list[tuple[Motion, Array]] = []
    for number, plan in enumerate(recipe.plans):
        motion_seed = int(make_stream(seed, machine.name, "motion", str(plan.trajectory)).integers(2**62))
        motion = make_motion(machine, plan.kind, motion_seed, recipe.duration, fine, recipe.locked)
        rng = make_stream(seed, machine.name, "temperature", str(number))
        runs.append((motion, _temperature(plan, len(machine.joints), motion.t, rng)))
    train = [run for run, plan in zip(runs, recipe.plans, strict=True) if plan.use == "train"]
    quiet = np.vstack([behave(setting, m, temp, [], body).tau for m, temp in train])
    sigma = recipe.noise_level * np.sqrt(np.mean(quiet**2, axis=0))

    actives: list[Active] = []
    entries: list[dict[str, Any]] = []
    for number, plant in enumerate(planted):
        rng = make_stream(seed, machine.name, "plant", str(number), plant.effect, plant.joint)
        made = make_plant(plant.effect, machine, machine.joints.index(plant.joint), rng)
        amplitude, joint = _scale(made, plant.size, sigma, train, setting, body)
        actives.append(Active(made, amplitude))
        entries.append(_describe(plant, made, amplitude, joint, machine))
    behaviours = [behave(setting, m, temp, actives, body) for m, temp in runs]
    thermal = any(plant.effect in THERMAL for plant in planted)
    with_temperature = recipe.temperatures
    if with_temperature is None:
        with_temperature = thermal or bool(make_stream(seed, machine.name, "channels").uniform() < 0.3)

    name = Path(folder).name
    declared = [
        effect
        for effect in ("rigid_body", "rotor_inertia", "coulomb", "viscous")
        if effect not in {LACKING[p.effect] for p in planted if p.effect in LACKING}
    ]
    _judge(entries, actives, train, setting, body, declared, sigma, recipe, bool(with_temperature))
    signals = write_folder(
        Path(folder), machine, setting, recipe, behaviours, sigma, seed, declared, bool(with_temperature)
    )
    truth: dict[str, Any] = {
        "dataset": name,
        "robot": robot,
        "seed": seed,
        "joints": list(machine.joints),
        "unit": machine.torque_unit(0),
        "recipe": asdict(recipe) | {"plans": [asdict(plan) for plan in recipe.plans]},
        "noise": recipe.noise,
        "noise_rms": dict(zip(machine.joints, sigma.tolist(), strict=True)),
        "declared": declared,
        "planted": entries,
    }
    if truth_path is not None:
        write_text(truth_path, json.dumps(truth, indent=1))
        write_table(Path(truth_path).with_suffix(".signals.parquet"), signals)
    return truth | {"signals": signals}


def _describe(
    plant: Planted, made: Term | Structural, amplitude: float, joint: int, machine: Machine
) -> dict[str, Any]:
    if isinstance(made, Term):
        parameters, form, extra = made.parameters(amplitude), made.form, made.extra
    else:
        parameters, form, extra = made.parameters(amplitude, machine), made.kind, dict(made.detail)
    everywhere = plant.effect == "payload_error"
    accept = extra.get("accept", [])
    assert isinstance(accept, list)
    return {
        "effect": plant.effect,
        "accepted": list(accepted_names(plant.effect)),
        "also_accepted": accept,
        "outside": plant.effect in OUTSIDE,
        "joint": machine.joints[joint],
        "joints": list(machine.joints) if everywhere else [machine.joints[joint]],
        "size": plant.size,
        "form": form,
        "parameters": {key: {"value": value, "unit": unit} for key, (value, unit) in parameters.items()},
        "extra": {key: value for key, value in extra.items() if key != "accept"},
    }


def _judge(
    entries: list[dict[str, Any]], actives: list[Active], train: list[tuple[Motion, Array]], setting: Setting,
    body: Body, declared: list[str], sigma: Array, recipe: Recipe, with_temperature: bool,
) -> None:  # fmt: skip
    """Add measured size, unabsorbed size and separability to every entry, from its plant acting alone."""
    machine = setting.machine
    for entry, active in zip(entries, actives, strict=True):
        alone = [behave(setting, m, temp, [active], body) for m, temp in train]
        every = slice(None, None, OVERSAMPLING)
        torque = [b.plant_torque[every] for b in alone]
        ratio = np.sqrt(np.mean(np.vstack(torque) ** 2, axis=0)) / sigma
        payload = machine.payload_mass > 0
        tracks = [
            make_track(
                body, machine.urdf, b.t[every], b.q[every], b.v[every], b.a[every],
                b.temperature[every] if with_temperature else None, payload, b.load[every],
            )
            for b in alone
        ]  # fmt: skip
        concerned = [machine.joints.index(entry["joint"])]
        if entry["effect"] == "payload_error":
            concerned = [j for j in range(len(machine.joints)) if ratio[j] >= 0.5]
        rivals: dict[str, float] = {}
        best = 0.0
        for number, j in enumerate(concerned):
            families = Families(tracks, j, recipe.rate, machine.prismatic[j], declared)
            order = entry["parameters"].get("order", {}).get("value")
            found = judge_separability(
                families, entry["effect"], [x[:, j] for x in torque], float(sigma[j]), order
            )
            here = found["rivals"]
            assert isinstance(here, dict)
            rivals = dict(here) if number == 0 else {k: r for k, r in rivals.items() if k in here}
            nearest = project_parameter(families, entry["effect"], [x[:, j] for x in torque])
            if nearest is not None:
                main_parameter = entry["parameters"].get(ONE_COEFFICIENT[entry["effect"]])
                if main_parameter is not None:
                    main_parameter["nearest"] = nearest
            unabsorbed = found["unabsorbed"]
            assert isinstance(unabsorbed, float)
            if unabsorbed / sigma[j] >= best:
                best = unabsorbed / float(sigma[j])
                entry["absorbed_share"], entry["own_left"] = found["absorbed_share"], found["own"]
        main = machine.joints.index(entry["joint"])
        entry["measured_size"] = float(ratio[main])
        entry["unabsorbed_size"] = best
        entry["rivals"] = rivals
        entry["separable"] = bool(not rivals and best >= max(UNABSORBED, 0.1 * float(ratio[main])))
