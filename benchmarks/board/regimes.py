"""The board's regimes: the axes of a Latin hypercube by the project's own designs, and the cases on it.

A part is ``development`` or ``held_out``. The seeds of the two never meet, and some families are held out
altogether: see `HELD_OUT`. Development never sees them; the held-out part draws from all families.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.board.draw_machines import FAMILIES, draw_machine
from benchmarks.board.outside import KINDS as OUTSIDE_KINDS
from benchmarks.board.outside import TWO_JOINTS
from benchmarks.board.recipe import Planted, Recipe, RunPlan, make_stream
from wearscope.demonstration.motions import Machine
from wearscope.designs.factors import Factor
from wearscope.designs.kinds import make_design
from wearscope.errors import InputError

PARTS = ("development", "held_out")
HELD_OUT: dict[str, tuple[str, ...]] = {
    "machine": ("scara", "staubli"),
    "motion": ("through",),
    "noise": ("heavy", "harmonics"),
    "outside": ("history",),
}
"""What only the held-out part has, by axis."""

MOST_VALUES = 600_000
"""Rows times joints of a case at most; longer ones are shortened, and say so."""
SHORTEST = 10.0
"""Shortest run [s]."""

DECLARED: dict[str, tuple[str, ...]] = {
    "nothing": (),
    "rigid_body": ("rigid_body",),
    "rigid_rotor": ("rigid_body", "rotor_inertia"),
    "coulomb_only": ("rigid_body", "rotor_inertia", "coulomb"),
    "friction": ("rigid_body", "rotor_inertia", "coulomb", "viscous"),
    "offset": ("rigid_body", "rotor_inertia", "coulomb", "viscous", "torque_offset"),
    "paper_friction": ("rigid_body", "rotor_inertia", "friction_wear_temperature"),
    "everything": (
        "rigid_body", "rotor_inertia", "coulomb", "viscous", "torque_offset", "stribeck",
        "load_dependent_friction",
    ),
}  # fmt: skip
COMPLETE = ("friction", "offset", "paper_friction", "everything")
"""Declared sets that leave nothing standard undeclared."""

CHOICES: dict[str, dict[str, float]] = {
    "machine": {name: 3.0 if name == "serial" else 1.5 if name in ("slide", "light_wrist") else 1.0
                for name in FAMILIES},
    "motion": {"mixed": 3.0, "fourier": 1.0, "sweep": 1.0, "points": 1.0, "cycle": 1.0, "through": 2.0},
    "pace": {"fast": 1.0, "mixed": 1.0, "slow": 1.0},
    "rate": {"50": 1.0, "100": 1.0, "200": 1.0, "250": 1.0, "500": 1.0, "1000": 1.0},
    "runs": {"1": 1.0, "2": 1.0, "3": 1.0, "4": 1.5, "6": 1.0, "10": 0.5},
    "test_runs": {"1": 1.0, "2": 1.0, "3": 1.0},
    "noise": {"plain": 1.0, "coloured": 2.0, "drift": 1.0, "jitter": 0.7, "hum": 1.0, "event": 0.7,
              "heavy": 1.5, "harmonics": 1.5},
    "acts": {"record": 3.0, "loop": 1.0},
    "inertials": {"exact": 5.0, "wrong": 1.0, "approximate": 1.0, "approximate_off": 2.0},
    "declared": {"friction": 4.0, "rigid_body": 2.0, "nothing": 0.7, "rigid_rotor": 1.5, "coulomb_only": 1.0,
                 "offset": 1.0, "paper_friction": 0.7, "everything": 1.0},
    "rotor": {"given": 2.0, "estimated": 1.0},
    "temperature": {"absent": 2.0, "measured": 1.0},
    "plants": {"null": 20.0, "one": 26.0, "two": 14.0, "three": 9.0, "several": 13.0, "outside": 18.0},
}  # fmt: skip
"""Levels of each axis of names, with their weights."""
RANGES: dict[str, tuple[float, float, str]] = {
    "duration": (10.0, 120.0, "s"),
    "noise_level": (0.003, 0.1, "1"),
    "memory": (0.02, 0.2, "s"),
    "frequency": (3.0, 60.0, "Hz"),
    "bandwidth": (4.0, 25.0, "Hz"),
    "encoder": (1e-6, 3e-4, "1"),
    "reversal": (2e-4, 4e-2, "1"),
    "size": (0.5, 16.0, "1"),
    "inertia_error": (0.05, 0.1, "1"),
}
"""Range of each axis of numbers; all are drawn evenly in the logarithm."""

ONE_JOINT = (
    "stribeck", "coulomb_asymmetry", "viscous_asymmetry", "quadratic_viscous", "concave_viscous",
    "load_dependent_friction", "temperature_dependent_friction", "warm_up_drift", "presliding_hysteresis",
    "backlash", "joint_elasticity", "torque_ripple", "joint_spring", "gravity_counterbalance",
    "torque_constant_error", "time_delay", "cross_coupling", "torque_offset", "rotor_inertia_error",
    "payload_error",
)  # fmt: skip
"""Effects of the vocabulary that a plant may be."""
LOADED = (
    "backlash", "joint_elasticity", "load_dependent_friction", "gravity_counterbalance",
    "torque_constant_error",
)  # fmt: skip
"""Effects that need load: they are planted on the inner half of the joints."""


@dataclass(frozen=True)
class Case:
    """One data set of the board, with the value of every axis."""

    number: int
    part: str
    seed: int
    axes: Mapping[str, Any]
    machine: Machine
    planted: tuple[Planted, ...]
    recipe: Recipe
    shortened: bool

    @property
    def name(self) -> str:
        """Name of the data set: a digest that tells nothing of the truth."""
        return "d" + hashlib.sha256(repr(self).encode()).hexdigest()[:12]

    @property
    def samples(self) -> float:
        """Samples of all joints in the training runs."""
        return len(self.machine.joints) * int(self.axes["runs"]) * self.recipe.duration * self.recipe.rate

    def make(self, folder: Path) -> dict[str, Any]:
        """Write the data set; the truth, which stays out of it."""
        from benchmarks.board.generate import generate_dataset

        truth = generate_dataset(folder, self.machine, self.planted, self.seed, self.recipe)
        return {key: value for key, value in truth.items() if key != "signals"}

    def tell(self) -> str:
        """The axes and the plants in a few words."""
        a, r = self.axes, self.recipe
        standard = {p.effect for p in self.planted if p.amplitude is not None}
        what = [f"{p.effect}@{p.joint}" for p in self.planted if p.amplitude is None]
        what += [f"({name})" for name in sorted(standard)]
        return (
            f"{a['machine']}{len(self.machine.joints)} {a['motion']} {r.rate:g} Hz "
            f"{a['runs']}x{r.duration:.0f} s, {a['noise']} {100 * r.noise_level:.1f} %"
            f"{' in loop' if r.loop_bandwidth else ''}, {a['inertials']}, {a['declared']}: "
            + (" + ".join(what) or "null")
        )


def choose_levels(axis: str, part: str) -> dict[str, float]:
    """Levels of an axis of names that a part has, with their weights."""
    hidden = HELD_OUT.get(axis, ()) if part == "development" else ()
    return {level: weight for level, weight in CHOICES[axis].items() if level not in hidden}


def choose_outside(part: str) -> list[str]:
    """Outside effects that a part has."""
    hidden = HELD_OUT["outside"] if part == "development" else ()
    return [name for kind, names in OUTSIDE_KINDS.items() if kind not in hidden for name in names]


def _pick(levels: Mapping[str, float], share: float) -> str:
    edges = np.cumsum(list(levels.values()))
    return list(levels)[int(np.searchsorted(edges / edges[-1], min(share, 1 - 1e-12), side="right"))]


def draw_axes(part: str, cases: int, seed: int) -> list[dict[str, Any]]:
    """Values of every axis for every case, by a Latin hypercube.

    Raises
    ------
    InputError
        For an unknown part or fewer than two cases.
    """
    if part not in PARTS:
        raise InputError(f"attribution board: there is no part '{part}'; choose one of {', '.join(PARTS)}.")
    names = [*CHOICES, *RANGES]
    # a design has one fault, called f: here the size of what is planted
    columns = {name: "f" if name == "size" else f"x_{name}" for name in names}
    factors = [
        Factor(columns[name], name, "fault" if name == "size" else "nuisance", "board", 0.0, 1.0)
        for name in names
    ]
    table = make_design("latin_hypercube", factors, {"points": cases, "stream": part}, seed)
    out: list[dict[str, Any]] = []
    for row in table.to_dict("records"):
        axes: dict[str, Any] = {}
        for name in CHOICES:
            axes[name] = _pick(choose_levels(name, part), float(row[f"{columns[name]}_natural"]))
        for name, (low, high, _) in RANGES.items():
            axes[name] = float(low * (high / low) ** float(row[f"{columns[name]}_natural"]))
        out.append(axes)
    return out


def list_cases(part: str, cases: int, seed: int) -> list[Case]:
    """Cases of a part of the board, in a fixed order.

    Parameters
    ----------
    part : str
        ``development`` or ``held_out``.
    cases : int
        Number of cases; the hypercube, and so every case, depends on it.
    seed : int
        Root of all seeds; 0 is a seed.
    """
    return [make_case(part, seed, number, axes) for number, axes in enumerate(draw_axes(part, cases, seed))]


def make_case(part: str, seed: int, number: int, axes: dict[str, Any]) -> Case:
    """Case of given axes; everything else of it is drawn from part, seed and number."""
    rng = make_stream(seed, part, str(number), "case")
    machine = draw_machine(axes["machine"], rng)
    joints = len(machine.joints)
    if axes["plants"] == "null":
        # undeclared friction and wrong masses are no null
        axes = axes | {"declared": _pick({k: CHOICES["declared"][k] for k in COMPLETE}, float(rng.uniform()))}
        if axes["inertials"] == "wrong":
            axes = axes | {"inertials": "exact"}
    if axes["acts"] == "loop" and axes["noise"] == "jitter":
        axes = axes | {"noise": "coloured"}
    train, test, rate = int(axes["runs"]), int(axes["test_runs"]), float(axes["rate"])
    duration, shortened = axes["duration"], False
    while (most := MOST_VALUES / (joints * rate * (train + test))) < SHORTEST and train + test > 2:
        train, test, shortened = max(1, train - 1), test if train > 1 else test - 1, True
    if duration > most:
        duration, shortened = most, True
    axes = axes | {"runs": str(train), "test_runs": str(test)}
    recipe = Recipe(
        noise=axes["noise"],
        noise_level=axes["noise_level"],
        duration=float(np.floor(duration * 10) / 10),
        rate=rate,
        temperatures=axes["temperature"] == "measured",
        inertia_error=axes["inertia_error"] if axes["inertials"] == "approximate_off" else 0.0,
        memory=axes["memory"],
        frequency=axes["frequency"],
        loop_bandwidth=axes["bandwidth"] if axes["acts"] == "loop" else None,
        encoder_step=axes["encoder"],
        reversal=axes["reversal"],
        declared=DECLARED[axes["declared"]],
        rotor_given=axes["rotor"] == "given",
        approximate=axes["inertials"].startswith("approximate"),
        oversampling=max(1, round(400 / rate)),
        bounded=True,
        plans=_plan_runs(axes, train, test, part, rng),
    )
    planted = (*_plant_standard(machine, recipe, rng), *_plant_effects(machine, recipe, axes, part, rng))
    own = int(make_stream(seed, part, str(number), "seed").integers(2**31))
    return Case(number, part, own, axes | {"joints": joints}, machine, planted, recipe, shortened)


def _plan_runs(
    axes: Mapping[str, Any], train: int, test: int, part: str, rng: np.random.Generator
) -> tuple[RunPlan, ...]:
    kinds = [kind for kind in choose_levels("motion", part) if kind != "mixed"]
    plans: list[RunPlan] = []
    for number in range(train + test):
        kind = axes["motion"] if axes["motion"] != "mixed" else str(rng.choice(kinds))
        pace = {"fast": 1.0, "slow": 0.4}.get(axes["pace"], float(rng.choice([0.4, 0.7, 1.0])))
        trajectory = number
        if number == 1 and train > 1 and rng.uniform() < 0.3:
            kind, pace, trajectory = plans[0].kind, plans[0].pace, 0
        use = "train" if number < train else "test"
        plans.append(RunPlan(use, kind, trajectory, float(rng.uniform(18.0, 55.0)), pace))
    return tuple(plans)


def _plant_standard(machine: Machine, recipe: Recipe, rng: np.random.Generator) -> list[Planted]:
    """Friction and rotor inertia that nobody declared, on the joints that have them."""
    declared, out = recipe.declared or (), []
    levels = {"rotor_inertia": machine.rotor_inertia, "coulomb": machine.coulomb, "viscous": machine.viscous}
    for effect, values in levels.items():
        has = rng.uniform(size=len(values)) < (1.0 if effect == "rotor_inertia" else 0.9)
        covered = effect in declared or (
            effect != "rotor_inertia" and "friction_wear_temperature" in declared
        )
        for joint, value, there in zip(machine.joints, values, has, strict=True):
            if there and not covered:
                out.append(Planted(effect, joint, float("nan"), float(value)))
    return out


def _plant_effects(
    machine: Machine, recipe: Recipe, axes: Mapping[str, Any], part: str, rng: np.random.Generator
) -> list[Planted]:
    count = {"null": 0, "one": 1, "two": 2, "three": 3, "outside": int(rng.integers(0, 2))}.get(
        axes["plants"], int(rng.integers(4, 7))
    )
    names = [name for name in ONE_JOINT if _is_possible(name, machine, recipe)]
    out: list[Planted] = []
    taken: set[tuple[str, str]] = set()
    if axes["plants"] == "outside":
        outer = [name for name in choose_outside(part) if len(machine.joints) > 1 or name not in TWO_JOINTS]
        out.append(Planted(str(rng.choice(outer)), str(rng.choice(machine.joints)), axes["size"]))
    if axes["inertials"] == "wrong":
        masses = np.array([link.mass for link in list(pin.buildModelFromXML(machine.urdf).inertias)[1:]])
        heavy = np.flatnonzero(masses >= np.median(masses))
        out.append(Planted("inertial_error", machine.joints[int(rng.choice(heavy))], axes["size"]))
    while count > 0:
        name = str(rng.choice(names))
        places = machine.joints
        if name in LOADED:
            places = places[: max(1, (len(places) + 1) // 2)]
        joint = machine.joints[-1] if name == "payload_error" else str(rng.choice(places))
        size = float(np.clip(axes["size"] * np.exp(0.5 * rng.normal()), 0.5, 16.0))
        count -= 1
        if (name, joint) not in taken:
            taken.add((name, joint))
            out.append(Planted(name, joint, size))
    return out


def _is_possible(name: str, machine: Machine, recipe: Recipe) -> bool:
    declared = recipe.declared or ()
    if name in declared:
        return False
    if name == "temperature_dependent_friction":
        return bool(recipe.temperatures)
    if name == "cross_coupling":
        return len(machine.joints) > 1
    if name == "payload_error":
        return machine.payload_mass > 0
    if name == "rotor_inertia_error":
        return "rotor_inertia" in declared and recipe.rotor_given
    return True
