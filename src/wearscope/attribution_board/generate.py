"""Makes measured-data folders with planted truth, and seals the truth outside of them."""

import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from wearscope.attribution_board.disturbances import check_noise, jitter_times, make_noise, quantise
from wearscope.attribution_board.features import Families, make_track
from wearscope.attribution_board.machines import Body, Machine, find_machine
from wearscope.attribution_board.motions import Motion, make_motion
from wearscope.attribution_board.outside import OUTSIDE
from wearscope.attribution_board.physics import (
    Active,
    Behaviour,
    Setting,
    Structural,
    behave,
    first_amplitude,
    make_plant,
)
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

OVERSAMPLING = 4
LACKING = {"rotor_inertia_error": "rotor_inertia", "coulomb": "coulomb", "viscous": "viscous"}
"""Effects that are planted by leaving a declared one out: no other joint of that machine has it."""
THERMAL = ("temperature_dependent_friction",)


@dataclass(frozen=True)
class Planted:
    """One effect to plant: name, joint name, and size (RMS of its torque over the noise RMS, train runs)."""

    effect: str
    joint: str
    size: float


@dataclass(frozen=True)
class RunPlan:
    """One run: its use, kind of motion, which drawn trajectory (equal numbers repeat), start temperature."""

    use: str
    kind: str
    trajectory: int
    start_temperature: float


PLANS: tuple[RunPlan, ...] = (
    RunPlan("train", "fourier", 0, 24.0),
    RunPlan("train", "fourier", 0, 43.0),
    RunPlan("train", "sweep", 1, 52.0),
    RunPlan("train", "points", 2, 31.0),
    RunPlan("test", "points", 3, 47.0),
    RunPlan("test", "sweep", 4, 28.0),
)


@dataclass(frozen=True)
class Recipe:
    """How a data set is recorded.

    Attributes
    ----------
    noise : str
        A kind of `disturbances.NOISES`.
    noise_level : float
        Torque noise RMS over the RMS of the declared torque, by joint.
    duration : float
        Length of a run [s].
    rate : float
        [Hz]
    temperatures : bool or None
        Whether temperature channels are recorded; None lets the seed decide (always where they matter).
    inertia_error : float
        Standard deviation of the factor by which the folder's URDF misses every link's mass and inertia;
        where it is not 0, the data set says ``inertials: approximate``.
    plans : tuple of RunPlan
    """

    noise: str = "plain"
    noise_level: float = 0.005
    duration: float = 16.0
    rate: float = 250.0
    temperatures: bool | None = None
    inertia_error: float = 0.0
    plans: tuple[RunPlan, ...] = field(default=PLANS)


def _stream(seed: int, *identity: str) -> np.random.Generator:
    """Random stream of a named thing: seed and identity, never the order of execution."""
    key = [int(byte) for byte in "/".join(identity).encode()]
    return np.random.default_rng(np.random.SeedSequence([seed, *key]))


def _setting(machine: Machine, seed: int, planted: Sequence[Planted]) -> Setting:
    rng = _stream(seed, machine.name, "setting")
    n = len(machine.joints)
    lacking = {LACKING[p.effect] for p in planted if p.effect in LACKING}
    values = {
        "coulomb": np.asarray(machine.coulomb) * rng.uniform(0.8, 1.2, n),
        "viscous": np.asarray(machine.viscous) * rng.uniform(0.8, 1.2, n),
        "rotor_inertia": np.asarray(machine.rotor_inertia),
    }
    for name in lacking:
        values[name] = np.zeros(n)
    grain = np.asarray(machine.speed) * rng.uniform(0.0005, 0.002, n)
    return Setting(machine, values["coulomb"], values["viscous"], values["rotor_inertia"], grain)


def _temperature(plan: RunPlan, n: int, t: Array, rng: np.random.Generator) -> Array:
    """Joints warming from their start towards a balance of their own (N, n)."""
    start = plan.start_temperature + rng.uniform(-1.5, 1.5, n)
    rise, time = rng.uniform(2.0, 6.0, n), rng.uniform(15.0, 40.0, n)
    return start + rise * (1 - np.exp(-t[:, None] / time))


def _plant_torque(behaviour: Behaviour) -> Array:
    return behaviour.tau - behaviour.declared


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
            [_plant_torque(behave(setting, m, temp, active, body))[::OVERSAMPLING] for m, temp in runs]
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
        motion_seed = int(_stream(seed, machine.name, "motion", str(plan.trajectory)).integers(2**62))
        motion = make_motion(machine, plan.kind, motion_seed, recipe.duration, fine)
        rng = _stream(seed, machine.name, "temperature", str(number))
        runs.append((motion, _temperature(plan, len(machine.joints), motion.t, rng)))
    train = [run for run, plan in zip(runs, recipe.plans, strict=True) if plan.use == "train"]
    quiet = np.vstack([behave(setting, m, temp, [], body).tau for m, temp in train])
    sigma = recipe.noise_level * np.sqrt(np.mean(quiet**2, axis=0))

    actives: list[Active] = []
    entries: list[dict[str, Any]] = []
    for number, plant in enumerate(planted):
        rng = _stream(seed, machine.name, "plant", str(number), plant.effect, plant.joint)
        made = make_plant(plant.effect, machine, machine.joints.index(plant.joint), rng)
        amplitude, joint = _scale(made, plant.size, sigma, train, setting, body)
        actives.append(Active(made, amplitude))
        entries.append(_describe(plant, made, amplitude, joint, machine))
    behaviours = [behave(setting, m, temp, actives, body) for m, temp in runs]
    thermal = any(plant.effect in THERMAL for plant in planted)
    with_temperature = recipe.temperatures
    if with_temperature is None:
        with_temperature = thermal or bool(_stream(seed, machine.name, "channels").uniform() < 0.3)

    name = Path(folder).name
    declared = [
        effect
        for effect in ("rigid_body", "rotor_inertia", "coulomb", "viscous")
        if effect not in {LACKING[p.effect] for p in planted if p.effect in LACKING}
    ]
    _judge(entries, actives, train, setting, body, declared, sigma, recipe, bool(with_temperature))
    signals = _write_folder(
        Path(folder), machine, setting, recipe, behaviours, sigma, seed, declared, bool(with_temperature)
    )
    truth: dict[str, Any] = {
        "dataset": name,
        "robot": robot,
        "seed": seed,
        "joints": list(machine.joints),
        "unit": machine.torque_unit,
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
        torque = [_plant_torque(b)[every] for b in alone]
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
            families = Families(tracks, j, recipe.rate, machine.prismatic, declared)
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


def _miss_inertials(urdf: str, error: float, rng: np.random.Generator) -> str:
    """URDF text with every link's mass and inertia off by one factor a link (so they stay consistent)."""

    def link(match: re.Match[str]) -> str:
        factor = float(np.exp(error * rng.normal()))

        def scaled(number: re.Match[str]) -> str:
            return f'{number[1]}="{float(number[2]) * factor:.6g}"'

        return re.sub(r'(value|i[xyz][xyz])="([^"]*)"', scaled, match[0])

    return re.sub(r"<inertial>.*?</inertial>", link, urdf)


def _write_folder(
    folder: Path, machine: Machine, setting: Setting, recipe: Recipe, behaviours: list[Behaviour],
    sigma: Array, seed: int, declared: list[str], with_temperature: bool,
) -> dict[str, Array]:  # fmt: skip
    joints, pos, tau_unit = machine.joints, machine.position_unit, machine.torque_unit
    resolution = 2 * np.pi / (2**17 * np.asarray(machine.gear_ratio))
    sealed: dict[str, list[Array]] = {"run": [], "t": []}
    listing: list[dict[str, Any]] = []
    for number, (plan, b) in enumerate(zip(recipe.plans, behaviours, strict=True)):
        rng = _stream(seed, machine.name, "noise", str(number))
        t = b.t[::OVERSAMPLING]
        at_q, at_tau = jitter_times(t, recipe.noise, recipe.rate, rng)
        columns: dict[str, Array] = {"t": t}
        units = {"t": "s"}
        noise = make_noise(recipe.noise, len(t), sigma, recipe.rate, rng)
        q = np.column_stack([np.interp(at_q, b.t, b.q[:, j]) for j in range(len(joints))])
        clean = np.column_stack([np.interp(at_tau, b.t, b.tau[:, j]) for j in range(len(joints))])
        effect = _plant_torque(b)[::OVERSAMPLING]
        q = quantise(q, resolution, rng)
        sealed["run"].append(np.full(len(t), number, dtype=float))
        sealed["t"].append(t)
        for j, joint in enumerate(joints):
            columns[f"q_{joint}"], columns[f"tau_{joint}"] = q[:, j], clean[:, j] + noise[:, j]
            units[f"q_{joint}"], units[f"tau_{joint}"] = pos, tau_unit
            if with_temperature:
                columns[f"temp_{joint}"] = np.round(b.temperature[::OVERSAMPLING, j], 1)
                units[f"temp_{joint}"] = "degC"
            for key, value in (("clean", clean), ("noise", noise), ("effect", effect)):
                sealed.setdefault(f"{key}_{joint}", []).append(value[:, j])
        file = f"runs/r{number + 1}.parquet"
        write_table(folder / file, columns, units)
        entry: dict[str, Any] = {"file": file, "use": plan.use}
        if machine.payload_mass > 0:
            entry["payload"] = {"mass": machine.payload_mass, "com": list(machine.payload_com)}
        listing.append(entry)
    robot: dict[str, Any] = {
        "urdf": "robot.urdf",
        "joints": list(joints),
        "inertials": "approximate" if recipe.inertia_error else "trusted",
        "gravity": list(machine.gravity),
        "gear_ratio": list(machine.gear_ratio),
    }
    if "rotor_inertia" in declared:
        robot["rotor_inertia"] = setting.rotor.tolist()
    document = {
        "name": folder.name,
        "description": f"{len(joints)}-joint machine, recorded on {len(behaviours)} runs.",
        "source": "generated",
        "robot": robot,
        "sample_rate": recipe.rate,
        "units": {"q": pos, "tau": tau_unit},
        "declared_effects": declared,
        "runs": listing,
    }
    rng = _stream(seed, machine.name, "inertials")
    urdf = _miss_inertials(machine.urdf, recipe.inertia_error, rng) if recipe.inertia_error else machine.urdf
    write_text(folder / "robot.urdf", urdf)
    write_text(folder / "dataset.yaml", yaml.safe_dump(document, sort_keys=False))
    return {key: np.concatenate(parts) for key, parts in sealed.items()}
