"""Three plain readers of the same folders, to beat: largest correlation, stepwise BIC, fit everything."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt
from scipy.stats import norm

from wearscope.attribution_board.features import CUTOFF_HZ, Families, Track, make_track
from wearscope.attribution_board.machines import Body
from wearscope.tables import read_table

Array = NDArray[np.float64]

BASELINES = ("largest_correlation", "stepwise_bic", "fit_everything")
ALARM = 0.01
"""Level of the naive significance, shared out over all candidates (Bonferroni, independent samples)."""

STATED = {
    "torque_offset": "offset", "coulomb_asymmetry": "half_difference", "viscous_asymmetry": "half_difference",
    "quadratic_viscous": "slope", "load_dependent_friction": "coefficient", "torque_constant_error": "gain",
    "coulomb": "level", "viscous": "slope", "rotor_inertia": "inertia",
}  # fmt: skip


@dataclass(frozen=True)
class Problem:
    """One joint's regression over pooled runs.

    Attributes
    ----------
    joint : str
    target : array (N,)
    columns : array (N, P)
        The declared effects' columns first, then every variant of every candidate.
    declared : int
        How many columns are the declared effects'.
    slots : dict of str to list of array
        Columns of each candidate's variants, as positions in `columns`.
    held_target, held_columns : array
        The same over the pooled test runs.
    """

    joint: str
    target: Array
    columns: Array
    declared: int
    slots: dict[str, list[NDArray[np.int64]]]
    held_target: Array
    held_columns: Array

    def __post_init__(self) -> None:
        """Scale the columns once and keep their products."""
        scale = np.sqrt(np.mean(self.columns**2, axis=0)) + 1e-300
        whole = np.column_stack([self.columns / scale, self.target])
        object.__setattr__(self, "scale", scale)
        object.__setattr__(self, "products", whole.T @ whole)

    scale: Array = field(init=False)
    products: Array = field(init=False)

    def solve(self, chosen: NDArray[np.int64]) -> tuple[Array, float, Array]:
        """Least squares on some columns: coefficients, sum of squares left, naive standard errors."""
        power = float(self.products[-1, -1])
        if len(chosen) == 0:
            return np.zeros(0), power, np.zeros(0)
        gram = self.products[np.ix_(chosen, chosen)] + 1e-9 * len(self.target) * np.eye(len(chosen))
        right = self.products[chosen, -1]
        inverse = np.linalg.inv(gram)
        solution = inverse @ right
        left = max(power - float(2 * solution @ right - solution @ (gram @ solution)), 1e-12 * power)
        error = np.sqrt(left / len(self.target) * np.clip(np.diag(inverse), 0, None))
        return solution / self.scale[chosen], left, error / self.scale[chosen]

    def base(self) -> NDArray[np.int64]:
        """Positions of the declared columns."""
        return np.arange(self.declared)


def _read_tracks(folder: Path, document: dict[str, Any], use: str) -> list[tuple[Track, Array]]:
    robot, rate = document["robot"], float(document["sample_rate"])
    urdf = (folder / robot["urdf"]).read_text(encoding="utf-8")
    gravity = tuple(robot.get("gravity", (0.0, 0.0, -9.81)))
    sos = butter(3, CUTOFF_HZ, fs=rate, output="sos")
    tracks = []
    for run in document["runs"]:
        if run["use"] != use:
            continue
        table = read_table(folder / run["file"])
        joints = robot["joints"]
        raw = table[[f"q_{joint}" for joint in joints]].to_numpy()
        q = sosfiltfilt(sos, raw, axis=0)
        v = np.gradient(q, 1 / rate, axis=0, edge_order=2)
        a = np.gradient(v, 1 / rate, axis=0, edge_order=2)
        temperature = None
        if f"temp_{joints[0]}" in table:
            temperature = table[[f"temp_{joint}" for joint in joints]].to_numpy()
        load = run.get("payload", {"mass": 0.0, "com": (0.0, 0.0, 0.0)})
        body = Body(urdf, gravity, float(load["mass"]), tuple(load["com"]))
        track = make_track(
            body, urdf, table["t"].to_numpy(), q, v, a, temperature, payload=float(load["mass"]) > 0
        )
        tracks.append((track, table[[f"tau_{joint}" for joint in joints]].to_numpy()))
    return tracks


def pose_problems(dataset: str | Path) -> list[Problem]:
    """Regression problems of a measured-data folder, by joint.

    Parameters
    ----------
    dataset : path-like
        ``dataset.yaml`` or its folder.
    """
    folder = Path(dataset)
    folder = folder.parent if folder.name == "dataset.yaml" else folder
    document = yaml.safe_load((folder / "dataset.yaml").read_text(encoding="utf-8"))
    train, test = (_read_tracks(folder, document, use) for use in ("train", "test"))
    rate, prismatic = float(document["sample_rate"]), document.get("units", {}).get("q") == "m"
    problems = []
    for j, joint in enumerate(document["robot"]["joints"]):
        families = Families([t for t, _ in train], j, rate, prismatic, document["declared_effects"])
        held = Families([t for t, _ in test], j, rate, prismatic, document["declared_effects"], like=families)

        slots: dict[str, list[NDArray[np.int64]]] = {}
        at = families.declared.shape[1]
        blocks, held_blocks = [families.declared], [held.declared]
        for name in families.names():
            for variant, twin in zip(families.variants(name), held.variants(name), strict=True):
                slots.setdefault(name, []).append(np.arange(at, at + variant.shape[1]))
                at += variant.shape[1]
                blocks.append(variant)
                held_blocks.append(twin)
        problems.append(
            Problem(
                joint,
                families.pool([tau[:, j] - track.rigid[:, j] for track, tau in train]),
                np.hstack(blocks),
                families.declared.shape[1],
                slots,
                held.pool([tau[:, j] - track.rigid[:, j] for track, tau in test]),
                np.hstack(held_blocks),
            )
        )
    return problems


def _best_variant(problem: Problem, base: NDArray[np.int64], name: str) -> tuple[int, float]:
    sums = [problem.solve(np.concatenate([base, slot]))[1] for slot in problem.slots[name]]
    return int(np.argmin(sums)), float(min(sums))


def pick_largest_correlation(problems: list[Problem]) -> list[tuple[int, str, int]]:
    """The one column, of all joints, that correlates most with the declared model's residual, if at all.

    Of candidates that share a column, the one with the fewest columns is taken.
    """
    best: tuple[float, int, int, str, int] = (0.0, 0, 0, "", 0)
    tried = rows = 0
    for number, problem in enumerate(problems):
        declared = problem.columns[:, : problem.declared]
        residual = problem.target - declared @ problem.solve(problem.base())[0]
        rows = len(residual)
        products = problem.columns.T @ residual
        sizes = np.linalg.norm(problem.columns, axis=0) * np.linalg.norm(residual) + 1e-300
        for name, slots in problem.slots.items():
            for index, slot in enumerate(slots):
                tried += len(slot)
                correlation = round(float(np.max(np.abs(products[slot]) / sizes[slot])), 9)
                best = max(best, (correlation, -len(slot), number, name, index))
    threshold = float(norm.isf(ALARM / 2 / max(tried, 1))) / np.sqrt(max(rows, 1))
    return [best[2:]] if best[0] > threshold else []


def pick_stepwise_bic(problems: list[Problem]) -> list[tuple[int, str, int]]:
    """Forward selection by the Bayesian information criterion on every joint."""
    picks = []
    for number, problem in enumerate(problems):
        base, rows = problem.base(), len(problem.target)
        score = rows * np.log(problem.solve(base)[1] / rows) + len(base) * np.log(rows)
        taken: set[str] = set()
        for _ in range(6):
            options = []
            for name in problem.slots:
                if name not in taken:
                    index, left = _best_variant(problem, base, name)
                    width = len(base) + len(problem.slots[name][index])
                    options.append((rows * np.log(left / rows) + width * np.log(rows), name, index))
            if not options or min(options)[0] >= score:
                break
            score, name, index = min(options)
            taken.add(name)
            base = np.concatenate([base, problem.slots[name][index]])
            picks.append((number, name, index))
    return picks


def pick_fit_everything(problems: list[Problem]) -> list[tuple[int, str, int]]:
    """All candidates of a joint in one least squares; the largest t of all joints, where significant."""
    best: tuple[float, int, str, int] = (0.0, 0, "", 0)
    tried = 0
    for number, problem in enumerate(problems):
        chosen = {name: _best_variant(problem, problem.base(), name)[0] for name in problem.slots}
        parts = [problem.slots[name][index] for name, index in chosen.items()]
        owners = [name for name, part in zip(chosen, parts, strict=True) for _ in part]
        solution, _, error = problem.solve(np.concatenate([problem.base(), *parts]))
        tried += len(owners)
        skip = problem.declared
        for name, value, spread in zip(owners, solution[skip:], error[skip:], strict=True):
            t = abs(value) / spread if spread > 0 else 0.0
            best = max(best, (float(t), number, name, chosen[name]))
    return [best[1:]] if best[0] > float(norm.isf(ALARM / 2 / max(tried, 1))) else []


PICKERS = {
    "largest_correlation": pick_largest_correlation,
    "stepwise_bic": pick_stepwise_bic,
    "fit_everything": pick_fit_everything,
}


def _verdict(name: str, document: dict[str, Any], problems: list[Problem], picks: list[tuple[int, str, int]],
             units: dict[str, str]) -> dict[str, Any]:  # fmt: skip
    entries, joints = [], {}
    tests = [run["file"] for run in document["runs"] if run["use"] == "test"]
    for number, problem in enumerate(problems):
        mine = [(effect, problem.slots[effect][index]) for n, effect, index in picks if n == number]
        full = np.concatenate([*[slot for _, slot in mine], problem.base()])
        before, _, _ = problem.solve(problem.base())
        after, _, spread = problem.solve(full)
        residuals = [
            problem.held_target - problem.held_columns[:, : problem.declared] @ before,
            problem.held_target - problem.held_columns[:, full] @ after,
        ]
        parts = [np.array_split(x, len(tests) or 1) for x in residuals]
        joints[problem.joint] = {
            "unit": units["tau"],
            "rms_before": float(np.sqrt(np.mean(residuals[0] ** 2))),
            "rms_after": float(np.sqrt(np.mean(residuals[1] ** 2))),
            "noise_floor": None,
            "test_runs": {
                file: [float(np.sqrt(np.mean(x**2))), float(np.sqrt(np.mean(y**2)))]
                for file, x, y in zip(tests, *parts, strict=True)
            },
        }
        at = 0
        for effect, slot in mine:
            parameters = {}
            if effect in STATED and len(slot) == 1:
                value, half = float(after[at]), 1.96 * float(spread[at])
                unit = _unit_of(effect, units)
                parameters[STATED[effect]] = {
                    "value": value,
                    "ci95": [value - half, value + half],
                    "unit": unit,
                }
            at += len(slot)
            entries.append({"joint": problem.joint, "effect": effect, "equivalent": [], "depends_on": [],
                            "parameters": parameters, "error_reduction": 0.0})  # fmt: skip
    return {"dataset": name, "verdict": entries, "joints": joints}


def _unit_of(effect: str, units: dict[str, str]) -> str:
    tau, pos = units["tau"], units["q"]
    if effect in ("viscous", "viscous_asymmetry"):
        return f"{tau} s/{pos}"
    if effect == "quadratic_viscous":
        return f"{tau} s^2/{pos}^2"
    if effect == "rotor_inertia":
        return "kg" if pos == "m" else "kg m^2"
    return "1" if effect in ("load_dependent_friction", "torque_constant_error") else tau


def run_baselines(dataset: str | Path) -> dict[str, dict[str, Any]]:
    """Verdicts of the three baselines on one folder, in the form of ``verdict.json``, by baseline name."""
    folder = Path(dataset)
    folder = folder.parent if folder.name == "dataset.yaml" else folder
    document = yaml.safe_load((folder / "dataset.yaml").read_text(encoding="utf-8"))
    units = {"q": "rad", "tau": "N m"} | document.get("units", {})
    problems = pose_problems(folder)
    return {
        name: _verdict(document["name"], document, problems, pick(problems), units)
        for name, pick in PICKERS.items()
    }
