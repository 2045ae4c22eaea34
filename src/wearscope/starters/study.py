"""Writes a study's folder: its configuration, and a Snakefile that includes the installed workflow."""

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from wearscope.checking.robot import find_idle_factors
from wearscope.config import label
from wearscope.errors import InputError
from wearscope.home import find_home
from wearscope.robots.friction import carry_over, find_lacking
from wearscope.robots.model import RobotModel, load_model
from wearscope.simulation.feasibility import check_robot
from wearscope.starters.writing import check_folder_name, fill_template, new_folder, quote
from wearscope.storage.files import copy_file

#: Robot whose dependence of friction on wear and temperature is copied to models that have none, such as
#: those that a diagnosis wrote.
LENDER = "medium"
#: Friction law of the paper's eq. (17). Where all robots have it, a small study also tests doubled Coulomb
#: friction.
EQ_17 = "friction_wear_temperature"
#: Detectors, and test-cycles, of a new study where the user names none.
DETECTORS = {
    "A": "{use: residual_energy, options: {align: path}}",
    "B": "distribution_distance",
    "C": "friction_fit",
}
CYCLES = ["point_to_point"]
ALL_CYCLES = [
    "point_to_point",
    "spot_welding",
    "iso_poses",
    "axis_sweeps",
    "slow_reversals",
    "periodic_excitation",
]
# Tables 1 and 3 of the paper: description, kind, range, unit, validation.
FACTORS: dict[str, tuple[str, str, tuple[float, float], str, tuple[float, float]]] = {
    "f": ("wear of the tested axis", "wear", (0, 50), '"1"', (5, 45)),
    "w1": ("wear of the first other axis", "wear", (0, 50), '"1"', (5, 45)),
    "w2": ("wear of the second other axis", "wear", (0, 50), '"1"', (5, 45)),
    "w3": ("temperature", "temperature", (30, 70), "degC", (35, 63)),
    "w4": ("point-to-point delay", "dwell", (25, 75), "ms", (31, 71)),
    "w5": ("payload mass error", "payload_mass_error", (-10, 10), '"%"', (-9, 3)),
}


def choose_factors(models: Sequence[RobotModel]) -> tuple[list[str], list[str]]:
    """Return the paper's factors that act on every robot, and a note for each factor that does not.

    Raises
    ------
    InputError
        Where wear does not act on one of the robots.
    """
    chosen: list[str] = []
    notes: list[str] = []
    for name, (_, kind, _, _, _) in FACTORS.items():
        wear = [one for one in chosen if FACTORS[one][1] == "wear"]
        asked = [*wear, name] if kind == "wear" else [name]
        ranges = {one: (FACTORS[one][1], *FACTORS[one][2]) for one in asked}
        reasons: list[str] = []
        for model in models:
            try:
                check_robot(model, ranges, 0.001)
                reasons += find_idle_factors(model, ranges).values()
            except InputError as error:
                reasons.append(str(error))
        if not reasons:
            chosen.append(name)
        elif name == "f":
            raise InputError(reasons[0])
        else:
            notes.append(f"Factor {name} ({FACTORS[name][0]}) is left out: {reasons[0]}")
    return chosen, notes


def write_study(
    target: Path,
    robots: Sequence[str],
    cycles: Sequence[str] = (),
    detectors: Mapping[str, str] | None = None,
    large: bool = False,
) -> list[str]:
    """Write a study's folder.

    Parameters
    ----------
    target : Path
        Folder to write; its last part is the study's name.
    robots, cycles : sequence of str
        Names, or paths relative to the working directory.
    detectors : mapping of str to str, optional
        Name of the module, or path, by the detector's name in the study.
    large : bool
        Whether the study is as large as the paper's; otherwise it takes a minute or two.

    Returns
    -------
    list of str
        Notes for the user.

    Raises
    ------
    InputError
        Where a robot cannot be used, or the folder exists already.
    """
    name = check_folder_name(target.name, "study")
    models = [load_model(robot) for robot in robots]
    borrowed = {}
    for k, model in enumerate(models):
        if find_lacking(model) and robots[k] != LENDER:
            models[k] = carry_over(model, load_model(LENDER))
            borrowed[quote(label(robots[k]))] = LENDER
    factors, notes = choose_factors(models)
    notes += [
        f"Robot {robot} lacks wear or temperature, which it borrows from {lender}: assumed, not identified."
        for robot, lender in borrowed.items()
    ]
    wear = [one for one in factors if FACTORS[one][1] == "wear"]
    nuisances = [one for one in factors if FACTORS[one][1] in ("temperature", "payload_mass_error")]
    scope = nuisances or [one for one in factors if one != "f"]
    if not scope:
        raise InputError(
            f"robot '{models[0].name}': nothing but wear acts on it; add temperature to its friction."
        )
    named = {key: _relate(use, target) for key, use in (detectors or {}).items()} or DETECTORS
    text = fill_template(
        "study.yaml",
        name=name,
        robots=[_relate(robot, target) for robot in robots],
        borrowed=borrowed,
        cycles=[_relate(cycle, target) for cycle in cycles] or (ALL_CYCLES if large else CYCLES),
        axes=list(range(1, len(wear) + 1)),
        detectors=named,
        factors=[_describe_factor(one) for one in factors],
        generators=", generators: [w5 = f w1 w2 w3 w4]" if len(factors) == len(FACTORS) else "",
        scope=scope,
        scope_grid="" if large else ", grid: [10, 10], runs: 10000",
        small=not large,
        doubled=all(any(one.effect == EQ_17 for one in model.effects) for model in models),
    )
    with new_folder(target) as folder:
        (folder / "config").mkdir()
        (folder / "config" / "config.yaml").write_text(text, encoding="utf-8")
        copy_file(find_home() / "config" / "schema.json", folder / "config" / "schema.json")
        (folder / "Snakefile").write_text(fill_template("Snakefile"), encoding="utf-8")
        profile = Path("profiles") / "default"
        shutil.copytree(find_home() / profile, folder / profile, copy_function=copy_file)
    return notes


def _relate(reference: str, target: Path) -> str:
    """Return a path relative to the study's folder, as YAML text; a name that is no path stays as it is."""
    there = Path(reference).exists()
    return quote(Path(os.path.relpath(reference, target)).as_posix() if there else reference)


def _describe_factor(name: str) -> str:
    """Return the line of a factor in the configuration."""
    description, kind, span, unit, validation = FACTORS[name]
    return (
        f"{name}: {{description: {description}, kind: {kind}, range: {list(span)}, unit: {unit}, "
        f"validation: {list(validation)}}}"
    )
