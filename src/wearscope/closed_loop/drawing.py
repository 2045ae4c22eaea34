"""Models that the data allow: drawn from the parameters' intervals and the names that tie."""

from collections.abc import Iterator

import numpy as np

from wearscope.closed_loop.diagnosis import Diagnosis
from wearscope.closed_loop.model.correction import make_corrected_model
from wearscope.closed_loop.model.declared import fit_declared
from wearscope.closed_loop.model.estimation import JointFit, draw_parameters, estimate_jointly
from wearscope.closed_loop.model.prediction import refit
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.robots.model import RobotModel


def draw_models(diagnosis: Diagnosis, stage: str, draws: int, seed: int) -> Iterator[RobotModel]:
    """Models of a stage, each as likely as the others.

    A term of the model after has each name of its set as often as the others: its own, and those
    ``equivalent`` to it, refitted. Parameters come from the joint distribution of that fit.

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
            fitted[key] = fit, estimate_jointly(fit)
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
