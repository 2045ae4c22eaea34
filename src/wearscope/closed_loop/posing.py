"""From a data set's folder to a problem: read, checked, delays that it declares taken out."""

from collections.abc import Callable, Sequence
from pathlib import Path

from wearscope.closed_loop.inference.delays import is_lag
from wearscope.closed_loop.inference.problem import Problem
from wearscope.closed_loop.intake.dataset import Dataset, read_dataset
from wearscope.closed_loop.intake.plausibility import check_plausibility
from wearscope.closed_loop.intake.thinning import Budget, prepare_thinned
from wearscope.closed_loop.model.declared import fit_declared_model
from wearscope.closed_loop.model.delays import move_by_delays
from wearscope.effects.base import Effect, load_effect
from wearscope.errors import InputError
from wearscope.robots.urdf import parse_urdf


def find_prismatic(urdf: Path, joints: list[str]) -> list[bool]:
    """Whether each named joint of a URDF is prismatic.

    Raises
    ------
    InputError
        Where the URDF has no such joint.
    """
    kinds = {joint.name: joint.kind for joint in parse_urdf(urdf).joints}
    for name in joints:
        if name not in kinds:
            raise InputError(f"{urdf}: there is no joint '{name}'; robot.joints may name {', '.join(kinds)}.")
    return [kinds[name] == "prismatic" for name in joints]


def read_measured(dataset: str | Path) -> Dataset:
    """Data set given by its folder or its ``dataset.yaml``.

    Raises
    ------
    InputError
        As of `wearscope.closed_loop.intake.dataset.read_dataset`.
    """
    path = Path(dataset)
    return read_dataset(path.parent if path.suffix in (".yaml", ".yml") else path, find_prismatic)


def pose_problem(
    dataset: str | Path | Dataset,
    progress: Callable[[str], None] = lambda _: None,
    effects: Sequence[str | Path] = (),
    allow_code: bool = False,
    budget: Budget | None = None,
) -> Problem:
    """What `diagnose` tests on a data set, whatever the score's numbers: the same arguments."""
    if not isinstance(dataset, Dataset):
        dataset = read_measured(dataset)
    declared, own = load_named_effects(dataset, effects, allow_code)
    prepared = prepare_thinned(dataset, budget)
    check_plausibility(prepared)
    problem = Problem(prepared, declared, own)
    late = [term.joint for term in problem.declared_terms if is_lag(term.effect)]
    if late:
        terms = [term for term in problem.declared_terms if not term.is_measurement_error]
        model = fit_declared_model(prepared, terms, problem.inertial, problem.layout.blocks)
        problem = Problem(move_by_delays(model, late, budget), declared, own)
    progress("; ".join(problem.prepared.notes))
    return problem


def load_named_effects(
    dataset: Dataset, effects: Sequence[str | Path], allow_code: bool
) -> tuple[list[Effect], list[Effect]]:
    """Declared effects and own candidates; files that the data set names only where that is allowed."""

    def load(name: str) -> Effect:
        if name.endswith(".py"):
            return load_effect(str(dataset.folder / name), allow_code=allow_code)
        return load_effect(name)

    declared = [load(name) for name in dataset.fields.declared_effects]
    own = [load_effect(str(path), allow_code=True) for path in effects]
    own += [load(name) for name in dataset.fields.effects]
    return declared, own
