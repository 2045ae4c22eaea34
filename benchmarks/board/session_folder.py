"""Writes a machine's sessions as a measured-data folder; the truth stays out of it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.board.folder import write_folder
from benchmarks.board.generate import make_setting, warm_up
from benchmarks.board.machines import Body
from benchmarks.board.motions import Motion, make_motion
from benchmarks.board.physics import Active, Behaviour, Setting, Structural, behave
from benchmarks.board.recipe import RunPlan, make_stream
from benchmarks.board.session_cases import Day, SessionCase
from benchmarks.board.terms import Signals, Term, temperature_dependent_friction
from wearscope.storage.tables import write_text

Array = NDArray[np.float64]

LOAD_SHARE = (0.05, 0.2)
"""Range of an undeclared load's RMS torque where it is felt most, over that of the joint's whole torque."""


def write_sessions(folder: Path, case: SessionCase) -> dict[str, Any]:
    """Write a case's folder.

    Returns
    -------
    dict
        The truth: `joint` (of wear or drive), `mass` [kg] of a load, and `sessions`, for each later one
        `session`, `wear` (share of friction), `torque` (its RMS [N m or N]), `load` (whether), `gain`.
    """
    machine, recipe = case.machine, case.recipe
    declared = list(recipe.declared or ())
    every = ("rigid_body", "rotor_inertia", "coulomb", "viscous")
    setting = make_setting(machine, case.seed, recipe, every)
    body = Body(machine.urdf, machine.gravity, machine.payload_mass, machine.payload_com)
    fine = recipe.rate * recipe.oversampling
    plans = [(day, plan) for day in case.days for plan in day.runs]
    motions, warmth = [], []
    for number, (_, plan) in enumerate(plans):
        seed = int(make_stream(case.seed, machine.name, "motion", str(plan.trajectory)).integers(2**62))
        motion = make_motion(machine, plan.kind, seed, recipe.duration, fine, (), plan.pace)
        motions.append(motion)
        rng = make_stream(case.seed, machine.name, "temperature", str(number))
        warmth.append(warm_up(plan, len(machine.joints), motion.t, rng))
    first = behave(setting, motions[0], warmth[0], [], body)
    heat = _make_heat(case, setting)
    worn = _make_wear(case, setting, first)
    mass = _choose_mass(case, setting, motions[0], warmth[0], body, first)
    behaviours = []
    for (day, _), motion, temperature in zip(plans, motions, warmth, strict=True):
        actives = [*heat, *_act(case, day, worn, mass)]
        behaviours.append(behave(_scatter(case, day, setting), motion, temperature, actives, body))
    sigma = recipe.noise_level * np.sqrt(np.mean(first.tau**2, axis=0))
    write_folder(
        folder, machine, setting, recipe, behaviours, [None] * len(plans), sigma, case.seed, declared,
        bool(recipe.temperatures),
    )  # fmt: skip
    path = folder / "dataset.yaml"
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    for (day, _), run in zip(plans, document["runs"], strict=True):
        run["session"] = day.name
    document["reference"] = [day.name for day in case.days if day.healthy]
    write_text(path, yaml.safe_dump(document, sort_keys=False))
    return {
        "joint": machine.joints[case.joint],
        "mass": mass,
        "sessions": [
            {
                "session": day.name,
                "wear": day.wear,
                "torque": day.wear * _measure_wear(case, setting, worn, day, plans, motions, warmth),
                "load": bool(day.load),
                "gain": day.gain,
            }
            for day in case.days
            if not day.healthy
        ],
    }


def _measure_wear(
    case: SessionCase, setting: Setting, worn: Term, day: Day, plans: list[tuple[Day, RunPlan]],
    motions: list[Motion], warmth: list[Array],
) -> float:  # fmt: skip
    """RMS torque of wear of one along a day's motions, where the joint moves."""
    torques = []
    for (own, _), m, temperature in zip(plans, motions, warmth, strict=True):
        if own is day:
            speed = np.asarray(case.machine.speed)
            signals = Signals(m.t, m.q, m.v, m.a, np.zeros_like(m.q), temperature, speed, setting.grain)
            moves = np.abs(m.v[:, case.joint]) > 0.01 * np.abs(m.v[:, case.joint]).max()
            torques.append(worn.shape(signals)[moves])
    return float(np.sqrt(np.mean(np.concatenate(torques) ** 2)))


def _friction(setting: Setting, signals: Signals, j: int) -> Array:
    return np.asarray(setting.coulomb[j] * signals.sign(j) + setting.viscous[j] * signals.v[:, j])


def _make_heat(case: SessionCase, setting: Setting) -> list[Active]:
    """Friction of every joint that falls with its temperature, each in a form of its own."""
    if case.thermal == 0.0:
        return []
    heat = []
    for j in range(len(case.machine.joints)):
        rng = make_stream(case.seed, case.machine.name, "heat", str(j))
        term = temperature_dependent_friction(case.machine, j, rng)
        size = setting.coulomb[j] + 0.5 * setting.viscous[j] * case.machine.speed[j]
        heat.append(Active(term, case.thermal * float(size)))
    return heat


def _make_wear(case: SessionCase, setting: Setting, first: Behaviour) -> Term:
    """Worn friction whose RMS along the first run is that of the joint's whole friction."""
    j, machine = case.joint, case.machine
    slow = 0.06 * machine.speed[j]

    def bump(s: Signals) -> Array:
        near = s.sign(j) / (1.0 + (s.v[:, j] / slow) ** 2)
        return np.asarray(near + 0.7 * s.v[:, j] / machine.speed[j])

    shapes: dict[str, Callable[[Signals], Array]] = {
        "whole": lambda s: _friction(setting, s, j),
        "coulomb": lambda s: s.sign(j),
        "bump": bump,
    }
    shape = shapes[case.form]
    signals = Signals(
        first.t, first.q, first.v, first.a, first.load, first.temperature, np.asarray(machine.speed),
        setting.grain,
    )  # fmt: skip
    size = np.sqrt(np.mean(_friction(setting, signals, j) ** 2) / np.mean(shape(signals) ** 2))
    return Term(j, lambda s: size * shape(s), lambda x: {"share": (x, "1")}, f"worn, {case.form}")


def _choose_mass(
    case: SessionCase, setting: Setting, motion: Motion, warmth: Array, body: Body, first: Behaviour
) -> float:
    """Mass of the load [kg]: it is felt by a share of `LOAD_SHARE` at some joint."""
    rng = make_stream(case.seed, case.machine.name, "load")
    share = float(rng.uniform(*LOAD_SHARE))
    one = Active(Structural("payload_error", len(case.machine.joints) - 1, {"shift": 0.0}), 1.0)
    felt = behave(setting, motion, warmth, [one], body).tau - first.tau
    ratio = np.sqrt(np.mean(felt**2, axis=0) / np.mean(first.tau**2, axis=0))
    return share / float(ratio.max())


def _act(case: SessionCase, day: Day, worn: Term, mass: float) -> list[Active]:
    actives: list[Active] = []
    if day.wear:
        actives.append(Active(worn, day.wear))
    if day.load:
        last = len(case.machine.joints) - 1
        actives.append(Active(Structural("payload_error", last, {"shift": 0.0}), day.load * mass))
    if day.gain:
        actives.append(Active(Structural("torque_constant_error", case.joint, {"sign": 1.0}), day.gain))
    return actives


def _scatter(case: SessionCase, day: Day, setting: Setting) -> Setting:
    """The machine with the friction of this day."""
    rng = make_stream(case.seed, case.machine.name, "day", day.name)
    factors = 1.0 + case.scatter * rng.normal(size=(2, len(setting.coulomb)))
    return replace(setting, coulomb=setting.coulomb * factors[0], viscous=setting.viscous * factors[1])
