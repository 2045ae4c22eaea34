"""Makes measured-data folders with planted truth, which stays outside of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.board.assessment import assess_entries
from benchmarks.board.disturbances import check_noise, make_noise
from benchmarks.board.folder import write_folder
from benchmarks.board.limits import limit_amplitude
from benchmarks.board.machines import Body, Machine, find_machine
from benchmarks.board.measured import bends, sample, separate
from benchmarks.board.motions import Motion, make_motion
from benchmarks.board.outside import OUTSIDE
from benchmarks.board.physics import (
    Active,
    Behaviour,
    Setting,
    Structural,
    behave,
    first_amplitude,
    make_plant,
)
from benchmarks.board.position_loop import react
from benchmarks.board.recipe import Planted, Recipe, RunPlan, make_stream
from benchmarks.board.terms import Term
from benchmarks.board.truth import CONTAINED, accepted_names
from benchmarks.scoring import start_entry
from wearscope.errors import InputError

Array = NDArray[np.float64]

LACKING = {"rotor_inertia_error": "rotor_inertia", "coulomb": "coulomb", "viscous": "viscous"}
"""Effects that a board without a declared set plants by leaving one out: no other joint then has it."""
STANDARD = ("rotor_inertia", "coulomb", "viscous", "torque_offset")
"""Effects that most machines have; where they are not declared they are planted on every joint."""
THERMAL = ("temperature_dependent_friction",)
WIDE = ("payload_error", "inertial_error", "rigid_body")
"""Effects that act on several joints at once."""


def declare_effects(recipe: Recipe, planted: Sequence[Planted]) -> list[str]:
    """Names that the data set declares."""
    if recipe.declared is not None:
        return list(recipe.declared)
    lacking = {LACKING[p.effect] for p in planted if p.effect in LACKING}
    return [name for name in ("rigid_body", "rotor_inertia", "coulomb", "viscous") if name not in lacking]


def make_setting(machine: Machine, seed: int, recipe: Recipe, declared: Sequence[str]) -> Setting:
    """The machine as this case has it: what is declared acts, what is not is left to the plants."""
    rng = make_stream(seed, machine.name, "setting")
    n = len(machine.joints)
    frictions = {
        "coulomb": np.asarray(machine.coulomb) * rng.uniform(0.8, 1.2, n),
        "viscous": np.asarray(machine.viscous) * rng.uniform(0.8, 1.2, n),
    }
    grain = np.asarray(machine.speed) * rng.uniform(0.0002, 0.001, n)
    if recipe.reversal is not None:
        grain = np.asarray(machine.speed) * recipe.reversal
    if "friction_wear_temperature" not in declared:
        for name in frictions:
            if name not in declared:
                frictions[name] = np.zeros(n)
    rotor = np.asarray(machine.rotor_inertia) if "rotor_inertia" in declared else np.zeros(n)
    share = rng.uniform(-0.3, 0.3, n) if "torque_offset" in declared else np.zeros(n)
    offset = share * np.asarray(machine.coulomb)
    return Setting(
        machine, frictions["coulomb"], frictions["viscous"], rotor, grain, offset, "rigid_body" in declared
    )


@dataclass
class Recording:
    """The runs of a case before any plant acts: motions, temperatures, quiet behaviour and noise RMS (n,)."""

    setting: Setting
    body: Body
    recipe: Recipe
    motions: list[Motion]
    temperatures: list[Array]
    loads: list[Array]
    sigma: Array

    def pick_training(self) -> list[int]:
        """Numbers of the training runs."""
        return [number for number, plan in enumerate(self.recipe.plans) if plan.use == "train"]

    def behave(self, number: int, actives: Sequence[Active]) -> Behaviour:
        """What a run would record with these plants."""
        return behave(
            self.setting, self.motions[number], self.temperatures[number], actives, self.body,
            self.loads[number],
        )  # fmt: skip

    def plant_torque(self, active: Active) -> list[Array]:
        """Torque (N, n) of one plant alone by training run, at the recorded rate."""
        every = slice(None, None, self.recipe.oversampling)
        return [self.behave(number, [active]).plant_torque[every] for number in self.pick_training()]

    def record_torque(self, active: Active) -> list[Array]:
        """What a record holds of it: of a motor that runs ahead of its link, no more than a sample tells."""
        if not bends([active]):
            return self.plant_torque(active)
        recipe = self.recipe
        torques = [self.behave(number, [active]).plant_torque for number in self.pick_training()]
        return [sample(x, recipe.rate, recipe.oversampling) for x in torques]


def warm_up(plan: RunPlan, n: int, t: Array, rng: np.random.Generator) -> Array:
    """Joints warming from their start towards a balance of their own (N, n)."""
    start = plan.start_temperature + rng.uniform(-1.5, 1.5, n)
    rise, time = rng.uniform(2.0, 6.0, n), rng.uniform(15.0, 40.0, n)
    return np.asarray(start + rise * (1 - np.exp(-t[:, None] / time)))


def record(
    machine: Machine, seed: int, recipe: Recipe, declared: Sequence[str], planted: Sequence[Planted]
) -> Recording:
    """Motions, temperatures and noise level of a case, before any effect of a size to be found is planted.

    Noise is a share of the torque of the joint as it is, with the friction and rotor inertia that nobody
    declared.
    """
    setting = make_setting(machine, seed, recipe, declared)
    body = Body(machine.urdf, machine.gravity, machine.payload_mass, machine.payload_com)
    fine = recipe.rate * recipe.oversampling
    motions, temperatures = [], []
    for number, plan in enumerate(recipe.plans):
        motion_seed = int(make_stream(seed, machine.name, "motion", str(plan.trajectory)).integers(2**62))
        motion = make_motion(machine, plan.kind, motion_seed, recipe.duration, fine, recipe.locked, plan.pace)
        rng = make_stream(seed, machine.name, "temperature", str(number))
        motions.append(motion)
        temperatures.append(warm_up(plan, len(machine.joints), motion.t, rng))
    loads = [body.torque(m.q, m.v, m.a) for m in motions]
    made = Recording(setting, body, recipe, motions, temperatures, loads, np.ones(len(machine.joints)))
    plain = [
        Active(_make_plant(plant, number, machine, seed), plant.amplitude)
        for number, plant in enumerate(planted)
        if plant.amplitude is not None
    ]
    quiet = np.vstack([made.behave(number, plain).tau for number in made.pick_training()])
    made.sigma = recipe.noise_level * np.sqrt(np.mean(quiet**2, axis=0))
    return made


def _make_plant(plant: Planted, number: int, machine: Machine, seed: int) -> Term | Structural:
    rng = make_stream(seed, machine.name, "plant", str(number), plant.effect, plant.joint)
    return make_plant(plant.effect, machine, machine.joints.index(plant.joint), rng)


def scale_plant(
    recording: Recording, plant: Term | Structural, wanted: float, effect: str
) -> tuple[float, int]:
    """Amplitude at which the plant's torque RMS is `wanted` noise RMS on the training runs, and its joint.

    An effect on several joints is measured at the joint where it stands out most. Where the recipe says
    `bounded`, the amplitude keeps to the machine's physical limits.

    Raises
    ------
    InputError
        Where the effect makes no torque on these runs.
    """
    setting = recording.setting
    amplitude, joint = first_amplitude(plant, setting.machine), plant.joint
    below, above = 0.0, np.inf
    for _ in range(25):
        torque = np.vstack(recording.plant_torque(Active(plant, amplitude)))
        ratio = np.sqrt(np.mean(torque**2, axis=0)) / recording.sigma
        if effect in WIDE:
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
        if effect == "inertial_error":
            # a mass can fall by no more than itself
            size = min(size, 0.9)
            if size == abs(amplitude):
                break
        amplitude = float(sign * size)
    if recording.recipe.bounded:
        amplitude = limit_amplitude(recording, plant, effect, amplitude)
    return amplitude, joint


def plant_effects(
    recording: Recording, planted: Sequence[Planted], seed: int
) -> tuple[list[Active], list[dict[str, Any]]]:
    """Plants with their amplitudes, and their entries of the truth."""
    machine = recording.setting.machine
    actives: list[Active] = []
    entries: list[dict[str, Any]] = []
    for number, plant in enumerate(planted):
        made = _make_plant(plant, number, machine, seed)
        if plant.amplitude is None:
            amplitude, joint = scale_plant(recording, made, plant.size, plant.effect)
        else:
            amplitude, joint = plant.amplitude, made.joint
        actives.append(Active(made, amplitude))
        entries.append(_describe(plant, made, amplitude, joint, machine))
    return actives, entries


def generate_dataset(
    folder: str | Path,
    robot: str | Machine,
    planted: Sequence[Planted],
    seed: int,
    recipe: Recipe | None = None,
) -> dict[str, Any]:
    """Write a measured-data folder with planted effects; the truth stays out of it.

    Parameters
    ----------
    folder : path-like
        The data set's folder; its last part is the data set's name, which must not tell the truth.
    robot : str or Machine
        A machine, or the name of one of `machines.MACHINES`.
    planted : sequence of Planted
        Empty for a null.
    seed : int
    recipe : Recipe, optional

    Returns
    -------
    dict
        `dataset`, `robot`, `seed`, `joints`, `unit`, `noise`, `noise_rms` (by joint), `declared`, `planted`
        (a list with `effect`, `accepted`, `also_accepted`, `contains`, `joint`, `joints`, `outside`,
        `standard`, `size`, `measured_size`, `parameters`, `form` and what `assessment.assess_entries`
        adds) and `signals`: noiseless torque (`clean_<joint>`), noise (`noise_<joint>`), the plants' torque
        (`effect_<joint>`) and positions as recorded (`position_<joint>`), by run.

    Raises
    ------
    InputError
        For an unknown machine, joint, effect or noise, or an effect that these motions do not excite.
    """
    recipe = recipe or Recipe()
    check_noise(recipe.noise)
    machine = find_machine(robot) if isinstance(robot, str) else robot
    for plant in planted:
        if plant.joint not in machine.joints:
            raise InputError(
                f"attribution board: {machine.name} has no joint '{plant.joint}'; choose one of "
                f"{', '.join(machine.joints)}."
            )
    declared = declare_effects(recipe, planted)
    recording = record(machine, seed, recipe, declared, planted)
    actives, entries = plant_effects(recording, planted, seed)
    with_temperature = recipe.temperatures
    if with_temperature is None:
        thermal = any(plant.effect in THERMAL for plant in planted)
        with_temperature = thermal or bool(make_stream(seed, machine.name, "channels").uniform() < 0.3)
    behaviours, noises, motions = _run_all(recording, actives, seed)
    signals = write_folder(
        Path(folder), machine, recording.setting, recipe, behaviours, noises, recording.sigma, seed, declared,
        bool(with_temperature),
    )  # fmt: skip
    torques = [recording.record_torque(active) for active in actives]
    if "rigid_body" not in declared:
        entries.append(_describe_rigid_body(machine))
        every = slice(None, None, recipe.oversampling)
        torques.append([recording.loads[number][every] for number in recording.pick_training()])
    separations = _separate_training(recording, actives, motions, behaviours, signals)
    assess_entries(entries, torques, recording, declared, separations, bool(with_temperature))
    return {
        "dataset": Path(folder).name,
        "robot": machine.name,
        "seed": seed,
        "joints": list(machine.joints),
        "unit": machine.torque_unit(0),
        "noise": recipe.noise,
        "noise_rms": dict(zip(machine.joints, recording.sigma.tolist(), strict=True)),
        "declared": declared,
        "planted": entries,
        "signals": signals,
    }


def _run_all(
    recording: Recording, actives: list[Active], seed: int
) -> tuple[list[Behaviour], list[Array | None], list[Motion]]:
    """Behaviour of every run with all plants, its disturbance where that acts in the loop, its motion."""
    recipe, machine = recording.recipe, recording.setting.machine
    behaviours: list[Behaviour] = []
    noises: list[Array | None] = []
    motions: list[Motion] = []
    for number, motion in enumerate(recording.motions):
        if recipe.loop_bandwidth is None:
            behaviours.append(recording.behave(number, actives))
            noises.append(None)
            motions.append(motion)
            continue
        rng = make_stream(seed, machine.name, "disturbance", str(number))
        disturbance = make_noise(
            recipe.noise, len(motion.t), recording.sigma, recipe.rate * recipe.oversampling, rng,
            recipe.memory, recipe.frequency,
        )  # fmt: skip
        # a motor without a declared rotor inertia still has one where it is planted as an effect
        rotor = np.asarray(machine.rotor_inertia)
        moved = react(recording.body, rotor, motion, disturbance, recipe.loop_bandwidth)
        temperature = recording.temperatures[number]
        behaviours.append(behave(recording.setting, moved, temperature, actives, recording.body))
        noises.append(disturbance[:: recipe.oversampling])
        motions.append(moved)
    return behaviours, noises, motions


def _separate_training(
    recording: Recording, actives: list[Active], motions: list[Motion], behaviours: list[Behaviour],
    signals: dict[str, Array],
) -> list[Array]:  # fmt: skip
    """Separation (N, n) of the record from the true model along the measured motion, by training run."""

    def stack(run: int, *keys: str) -> Array:
        rows = np.asarray(signals["run"]) == run
        return np.column_stack(
            [sum(np.asarray(signals[f"{key}_{joint}"])[rows] for key in keys) for joint in joints]
        )

    joints = recording.setting.machine.joints
    return [
        separate(
            recording.setting, recording.body, motions[k], behaviours[k], actives,
            recording.recipe.oversampling, stack(k, "position"), stack(k, "clean", "noise"),
        )
        for k in recording.pick_training()
    ]  # fmt: skip


def _describe(
    plant: Planted, made: Term | Structural, amplitude: float, joint: int, machine: Machine
) -> dict[str, Any]:
    form, extra = (made.form, made.extra) if isinstance(made, Term) else (made.kind, dict(made.detail))
    units = {"tau": machine.torque_unit(made.joint), "pos": machine.position_unit(made.joint)}
    accept = extra.get("accept", [])
    assert isinstance(accept, list)
    joints = machine.joints if plant.effect in WIDE else [machine.joints[joint]]
    return start_entry(plant.effect, machine.joints[joint], joints, plant.amplitude is not None) | {
        "accepted": list(accepted_names(plant.effect)),
        "also_accepted": accept,
        "contains": list(CONTAINED.get(plant.effect, ())),
        "outside": plant.effect in OUTSIDE,
        "size": plant.size,
        "form": form,
        "parameters": {
            key: {"value": value, "unit": unit.format(**units)}
            for key, (value, unit) in made.parameters(amplitude).items()
        },
        "extra": {key: value for key, value in extra.items() if key != "accept"},
    }


def _describe_rigid_body(machine: Machine) -> dict[str, Any]:
    """Entry of a rigid body that nobody declared; a slide's and a single upright axis's is an inertia."""
    alike = ["rotor_inertia", "rotor_inertia_error"] if len(machine.joints) == 1 else []
    return start_entry("rigid_body", machine.joints[0], machine.joints, True) | {
        "also_accepted": [*alike, "inertial_error", "payload_error"], "size": np.nan,
        "form": "inverse dynamics", "extra": {},
    }  # fmt: skip
