"""Closing the loop on one data set, from its folder to the files of the contract.

Among them are models that the data allow, drawn from the parameters' intervals and the names that tie.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wearscope.closed_loop.diagnosis import Diagnosis, diagnose
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.model.correction import make_corrected_model
from wearscope.closed_loop.model.declared import fit_declared
from wearscope.closed_loop.model.estimation import JointFit, draw_parameters, estimate_jointly
from wearscope.closed_loop.model.prediction import refit
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.robots.model import RobotModel, save_model
from wearscope.storage.verdicts import drawn_path


def close_loop(
    dataset: str | Path,
    out_dir: str | Path,
    light: bool = False,
    policy: Policy | None = None,
    progress: Callable[[str], None] = lambda _: None,
    effects: Sequence[str | Path] = (),
    allow_code: bool = False,
    draws: int = 0,
) -> dict[str, Any]:
    """Close the loop on a data set and write what was found.

    Parameters
    ----------
    dataset : path-like
        The data set's folder, or its ``dataset.yaml``.
    out_dir : path-like
        Where ``verdict.json``, ``residual.parquet``, ``candidates.parquet``, ``model_before.yaml``,
        ``model_after.yaml`` and, unless `light`, the tables of the diagnostics are written.
    light : bool
        Leave out forward simulation, diagnostics and the report.
    draws : int
        Models of each stage that the data allow, written to ``drawn/`` (`draw_models`).
    policy, progress, effects, allow_code
        As of `diagnose`.

    Returns
    -------
    dict
        The content of ``verdict.json``.

    Raises
    ------
    InputError
        Where the data set breaks the format or cannot be what it says; nothing is written then.
    """
    diagnosis = diagnose(dataset, policy, progress, effects, allow_code)
    extra: dict[str, Any] = {}
    if not light:
        from wearscope.closed_loop.diagnostics.examination import examine

        extra = examine(Path(out_dir), diagnosis, progress)
    for stage in ("before", "after") if draws else ():
        for number, model in enumerate(draw_models(diagnosis, stage, draws, diagnosis.policy.seed), start=1):
            save_model(model, Path(out_dir) / drawn_path(stage, number))
    return diagnosis.write(out_dir, extra)


def draw_models(diagnosis: Diagnosis, stage: str, draws: int, seed: int) -> Iterator[RobotModel]:
    """Models of a stage, each as likely as the others.

    In the models after, a term has its own name and each ``equivalent`` one equally often. The model is
    fitted again with it, and the parameters are drawn from the joint distribution of that fit.

    Parameters
    ----------
    diagnosis : Diagnosis
    stage : {"before", "after"}
    draws, seed : int
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, stage == "after"]))
    fitted: dict[tuple[str, ...], tuple[Regression, JointFit]] = {}
    options = _alternatives(diagnosis) if stage == "after" else []
    for _ in range(draws):
        chosen = [terms[int(rng.integers(len(terms)))] for terms in options]
        key = tuple(term.label for term in chosen)
        if key not in fitted:
            fit = _fit(diagnosis, stage, chosen)
            fitted[key] = fit, estimate_jointly(fit, most_rows=diagnosis.policy.most_rows)
        model, joint = fitted[key]
        ((theta, values),) = draw_parameters(model, joint, rng, 1)
        yield make_corrected_model(diagnosis.prepared, model, values, stage, theta)


def _fit(diagnosis: Diagnosis, stage: str, chosen: list[ModelTerm]) -> Regression:
    if stage == "before":
        return diagnosis.before
    if chosen == [one.term for one in diagnosis.attributions if one.kept]:
        return diagnosis.after
    found = {id(term) for term in diagnosis.problem.late}
    declared = [entry for entry in diagnosis.before.entries if id(entry) not in found]
    return refit(diagnosis.after, [*declared, *chosen])


def _alternatives(diagnosis: Diagnosis) -> list[list[ModelTerm]]:
    """Terms of each attribution: its own first, then those of its equivalent names that can be simulated."""
    problem = diagnosis.problem
    effects = {effect.name: effect for effect in problem.effects}
    options = []
    for named in (one for one in diagnosis.attributions if one.kept):
        terms = [named.term]
        for name in named.equivalent:
            effect = effects[name]
            joint = diagnosis.prepared.n - 1 if effect.per_robot else named.term.joint
            term = fit_declared(diagnosis.prepared, effect, joint, problem.joined)
            if term is not None:
                terms.append(term)
        options.append(terms)
    return options
